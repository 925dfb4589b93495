"""What softpipe makes of the cases that apply to it, from a process of its own: Mesa chooses a driver once."""

import json
import os
import subprocess
import sys
from functools import cache

from gsgi.runtime.gl.context import create_context, renderer_string

from .cases import CASES

LAYER = "softpipe"


@cache
def answers() -> dict[str, float | str] | None:
    """Worst errors by case, or the message of what went wrong; None where Mesa has no softpipe."""
    environment = os.environ | {"GALLIUM_DRIVER": LAYER, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-W", "ignore", "-m", "hard_cases.softpipe"]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


def main() -> None:
    """Print the answers of this process's driver as JSON."""
    gl = create_context()
    if LAYER not in renderer_string(gl):
        print("null")
        return
    found = {}
    for case in CASES:
        if LAYER in case.tolerances:
            try:
                found[case.name] = case.error(LAYER, gl)
            except AssertionError as error:
                found[case.name] = str(error) or "AssertionError"
    print(json.dumps(found))


if __name__ == "__main__":
    main()
