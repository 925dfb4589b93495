"""What works on this machine: each part is tried in a child process, since some fail by aborting."""

import subprocess
import sys
from dataclasses import dataclass

TIMEOUT = 120  # s

_GL = (
    "from gsgi.runtime.gl.context import create_context, renderer_string; print(renderer_string(create_context({!r})))"
)
_LLVM = "from gsgi.baker.trace import llvm; print(llvm.select())"
_MITSUBA = (
    "from gsgi.baker.trace.mitsuba_scene import load_mitsuba; m = load_mitsuba(); print(m.__version__, m.variant())"
)
_CUDA = (
    "from gsgi.baker.over.cuda_splat import unavailable; reason = unavailable(); assert reason is None, reason; "
    "import torch; print(torch.cuda.get_device_name())"
)
_DENOISER = "from gsgi.baker.trace import llvm; llvm.select(); import mitsuba_oidn; print('Open Image Denoise')"
_OPEN3D = "import open3d; print(open3d.__version__)"
_KERNELS = "import gsgi.baker._kernels; print('C++ rasteriser')"

_PARTS = (
    ("EGL", _GL.format("egl"), False, "apt-get install libegl1 libgl1-mesa-dri"),
    ("OSMesa", _GL.format("osmesa"), False, "apt-get install libosmesa6"),
    ("LLVM", _LLVM, True, "apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH"),
    ("Mitsuba", _MITSUBA, True, "install gsgi with its extra 'bake'"),
    (
        "Open3D",
        _OPEN3D,
        True,
        "install gsgi with its extra 'bake'; apt-get install libusb-1.0-0 libgl1 libx11-6 libgomp1",
    ),
    ("kernels", _KERNELS, True, "build the package: ./dev demo, or pip install ."),
    ("denoiser", _DENOISER, False, "install gsgi with its extra 'bake'; without it, bakes need more samples"),
    ("CUDA", _CUDA, False, "not needed: without it, the fit computes on the CPU"),
)


@dataclass(frozen=True)
class Check:
    """One part: whether it works, what it is, and what to do if it does not. `needed` ones make or break a bake."""

    name: str
    works: bool
    needed: bool
    detail: str
    advice: str = ""


def examine() -> list[Check]:
    """Try every part. A frame needs one of the two GL back-ends: where neither works, a last check says so."""
    checks = [_check(*part) for part in _PARTS]
    if not any(check.works for check in checks if check.name in ("EGL", "OSMesa")):
        checks.append(Check("OpenGL", False, True, "no back-end works", "install one of the two above"))
    return checks


def _check(name: str, code: str, needed: bool, advice: str) -> Check:
    try:
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return Check(name, False, needed, f"no answer within {TIMEOUT} s", advice)
    if run.returncode == 0:
        return Check(name, True, needed, run.stdout.strip().splitlines()[-1])
    lines = run.stderr.strip().splitlines()
    died = f"ended by signal {-run.returncode}" if run.returncode < 0 else "failed"
    return Check(name, False, needed, lines[-1].split(": ", 1)[-1] if lines else died, advice)
