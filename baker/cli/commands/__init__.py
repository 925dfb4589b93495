"""The commands of `gsgi`, one module each: `add` declares options, `run` executes and returns an exit code or None.

Importing them loads nothing heavy, because `run` does the heavy imports.
"""

from . import (
    bake,
    cache,
    compare,
    doctor,
    export,
    inspect,
    plan,
    recommend,
    reference,
    render,
    task,
    tasks,
    tradeoff,
    validate,
    view,
)

# In the order in which `gsgi --help` lists them.
COMMANDS = (
    plan,
    bake,
    render,
    view,
    reference,
    compare,
    tradeoff,
    recommend,
    export,
    inspect,
    validate,
    tasks,
    task,
    cache,
    doctor,
)
