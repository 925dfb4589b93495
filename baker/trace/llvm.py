"""Find a working LLVM for Mitsuba to compile its kernels with. An unsuitable one aborts the process."""

import logging
import os
import re
import signal
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
    """Whether a child process can compile and run a kernel with this libLLVM; True too if it never answers.

    Raises MemoryError if the child ran out of memory, which says nothing about LLVM.
    """
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(path)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    # -P: a file in the current folder may have the name of a module.
    with subprocess.Popen([sys.executable, "-P", "-c", _PROBE], env=environment, **pipes) as probe:
        try:
            output, errors = _outcome(probe, path)
        except subprocess.TimeoutExpired:
            _log.warning("this machine is slow: %s has not compiled a kernel yet; going on untested", path)
            return True
        finally:
            probe.kill()
    if probe.returncode == -signal.SIGKILL or b"failed to map segment" in errors:
        raise MemoryError(f"cannot load {path}")
    return probe.returncode == 0 and output.strip() == b"3.0"


def _outcome(probe: subprocess.Popen, path: Path) -> tuple[bytes, bytes]:
    """What a probe printed on stdout and stderr. Raises TimeoutExpired after SLOW + GIVE_UP."""
    try:
        return probe.communicate(timeout=SLOW)
    except subprocess.TimeoutExpired:
        _log.warning("this machine is slow: %s has not compiled a kernel yet; waiting on", path)
        return probe.communicate(timeout=GIVE_UP)


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
