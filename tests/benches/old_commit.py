"""A commit of the past, checked out and built in build/speed/, beside this one."""

import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from repository import ROOT

FOLDER = ROOT / "build" / "speed"
COMMIT = "8fdb6e3"  # the last whose paths are whole; its files have another format

# Reads B of a file at points with that commit's own decoder: the format has changed since.
_READ = """
import sys
import numpy as np
from pathlib import Path
from gsgi.baker.evaluate import evaluate
from gsgi.runtime import codec

file, points, light = sys.argv[1:]
bake, (position, normal) = codec.decode(Path(file).read_bytes()), np.load(points)
np.save(light, evaluate(bake.gaussians, bake.coarse, bake.blend, position, normal)[0])
"""


@dataclass(frozen=True)
class OldCommit:
    """The program of COMMIT, in an environment of its own with the packages that its lock names."""

    folder: Path

    @property
    def python(self) -> str:
        """Its interpreter."""
        return str(self.folder / ".venv" / "bin" / "python")

    def read(self, file: Path, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (S, 3) float32 of its file at points (S, 3), m, with unit normals (S, 3)."""
        with tempfile.TemporaryDirectory() as folder:
            points, light = (str(Path(folder, name)) for name in ("points.npy", "light.npy"))
            np.save(points, np.stack([position, normal]).astype(np.float32))
            subprocess.run([self.python, "-c", _READ, str(file), points, light], check=True)
            return np.load(light)


def built() -> OldCommit:
    """Check the commit out and build it, unless an earlier run did. Needs git, its history, and a package registry."""
    folder = FOLDER / COMMIT
    if not (folder / "ready").exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        files = subprocess.run(["git", "-C", str(ROOT), "archive", COMMIT], stdout=subprocess.PIPE, check=True)
        subprocess.run(["tar", "-x", "-C", str(folder)], input=files.stdout, check=True)
        uv = shutil.which("uv") or str(ROOT / "build" / "uv" / "bin" / "uv")
        sync = [uv, "sync", "--locked", "--quiet", "--extra", "bake", "--no-default-groups"]
        environment = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
        subprocess.run(sync, cwd=folder, check=True, env=environment)
        (folder / "ready").touch()
    return OldCommit(folder)
