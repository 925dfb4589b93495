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
def start() -> subprocess.Popen:
    """Begin to find the answers, beside whatever else runs meanwhile."""
    environment = os.environ | {"GALLIUM_DRIVER": LAYER, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-W", "ignore", "-m", "hard_cases.softpipe"]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@cache
def answers() -> dict[str, float | str] | None:
    """Worst errors by case, or the message of what went wrong; None where Mesa has no softpipe."""
    found, said = start().communicate()
    assert start().returncode == 0, said
    return json.loads(found)


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
