"""Find a working LLVM for Mitsuba to compile its kernels with. An unsuitable one aborts the process."""

import logging
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from gsgi.runtime.errors import UnsupportedError

# LLVM 14 is refused, 15 and 16 abort in code generation (fmaximum), and 17 and 18 are untested.
VERSION_MIN = 19

# s; a probe takes about one. A machine where it takes longer than SLOW is busy, which is said. No answer after GIVE_UP
# more proves nothing: an unsuitable LLVM aborts at once.
SLOW, GIVE_UP = 60.0, 600.0

_FOLDERS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib")
_NAME = re.compile(r"libLLVM(?:-(\d+)\.so(?:\.\d+)?|\.so\.(\d+)(?:\.\d+)*)$")
_log = logging.getLogger(__name__)

_PROBE = "import drjit as dr; from drjit.llvm import Float; print(dr.sum(dr.maximum(Float(1, 2), 0))[0])"


def libraries() -> list[tuple[int, Path]]:
    """(major version, path) of each libLLVM in the system's library folders, newest first."""
    folders = [*map(Path, _FOLDERS), *Path("/usr/lib").glob("llvm-*/lib")]
    found = {}
    for path in (file for folder in folders if folder.is_dir() for file in folder.glob("libLLVM*.so*")):
        if match := _NAME.match(path.name):
            found[path.resolve()] = int(match[1] or match[2])
    return sorted(((version, path) for path, version in found.items()), reverse=True)


def works(path: Path) -> bool:
    """Whether a child process can compile and run a kernel with this libLLVM; True too if it never answers."""
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(path)}
    command = [sys.executable, "-c", _PROBE]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as child:
        try:
            for patience, next_step in ((SLOW, "waiting on"), (GIVE_UP, "going on untested")):
                try:
                    output, _ = child.communicate(timeout=patience)
                except subprocess.TimeoutExpired:
                    _log.warning("this machine is slow: %s has not compiled a kernel yet; %s", path, next_step)
                else:
                    return child.returncode == 0 and output.strip() == b"3.0"
            return True
        finally:
            child.kill()


def select() -> Path:
    """Point DRJIT_LIBLLVM_PATH at the newest LLVM that works, unless it is set; call before Mitsuba is imported.

    Raises UnsupportedError if no LLVM works, if the one that is set does not work, or if Mitsuba is not installed.
    """
    if find_spec("drjit") is None:
        raise UnsupportedError("Mitsuba is not installed: install gsgi with its extra 'bake'")
    if chosen := os.environ.get("DRJIT_LIBLLVM_PATH"):
        if not works(Path(chosen)):
            raise UnsupportedError(f"{chosen} (DRJIT_LIBLLVM_PATH) is no LLVM that works here; install libllvm19")
        return Path(chosen)
    for version, path in libraries():
        if version >= VERSION_MIN and works(path):
            os.environ["DRJIT_LIBLLVM_PATH"] = str(path)
            return path
    raise UnsupportedError(
        f"no libLLVM >= {VERSION_MIN} works here and path tracing needs one: apt-get install libllvm19 "
        "(or set DRJIT_LIBLLVM_PATH)"
    )
