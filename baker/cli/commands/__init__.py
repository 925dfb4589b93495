"""The commands of `gsgi`, one module each: `add` declares its options, `run` does it and returns an exit code or None.

Importing them loads nothing heavy: that waits for `run`.
"""

from . import bake, cache, compare, doctor, inspect, plan, reference, render, validate, view

# As `gsgi --help` lists them.
COMMANDS = (plan, bake, render, view, reference, compare, inspect, validate, cache, doctor)
