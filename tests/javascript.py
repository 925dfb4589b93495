"""Runs the ES modules of runtime/js under Node.js."""

import shutil
import subprocess
from pathlib import Path

import pytest
from repository import ROOT

JS = ROOT / "runtime" / "js"
PATIENCE = 120  # s; how long a run may take on a busy machine


def node(*arguments: str | Path, **environment: str | Path) -> str:
    """What `node` prints. Skips where it is missing; fails with its output if it fails."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("node is not installed")
    environment = {"PATH": str(Path(program).parent), **{name: str(value) for name, value in environment.items()}}
    run = subprocess.run([program, *arguments], capture_output=True, text=True, env=environment, timeout=PATIENCE)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout
