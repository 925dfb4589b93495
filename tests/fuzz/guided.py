"""One target under libFuzzer: `python -m fuzz.guided TARGET [LIBFUZZER OPTIONS] [CORPUS FOLDERS]`."""

import inspect
import sys
from types import ModuleType

import atheris

from fuzz.targets import TARGETS

COVERED = "gsgi.runtime.gltf", "gsgi.runtime.file"


def main() -> None:
    """Run libFuzzer, which ends the process."""
    target, mutator = TARGETS[sys.argv.pop(1)]
    for name, module in list(sys.modules.items()):
        if name.startswith(COVERED):
            instrument(module)
    mutate = mutator and (lambda data, size, seed: mutator(data, size, seed, atheris.Mutate))
    atheris.Setup(sys.argv, target, **({"custom_mutator": mutate} if mutate else {}))
    atheris.Fuzz()


def instrument(module: ModuleType) -> None:
    """Count which branches of a module's functions and methods run; an editable install hides them from atheris."""
    classes = [value for value in vars(module).values() if inspect.isclass(value)]
    for holder in (module, *classes):
        for value in vars(holder).values():
            if inspect.isfunction(value) and value.__module__ == module.__name__:
                atheris.instrument_func(value)


if __name__ == "__main__":
    main()
