"""Check what works on this machine. Each part is tried in a child process, because some fail by aborting."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

TIMEOUT = 120  # s

_GL = (
    "from gsgi.runtime.gl.context import create_context, renderer_string; print(renderer_string(create_context({!r})))"
)
_LLVM = "from gsgi.baker.trace import llvm; print(llvm.select())"
_MITSUBA = (
    "from gsgi.baker.trace.mitsuba_scene import load_mitsuba; m = load_mitsuba(); print(m.__version__, m.variant())"
)
_OPEN3D = "import open3d; print(open3d.__version__)"
_KERNELS = "from gsgi.baker.native import kernels; print(', '.join(kernels.instruction_sets()))"
_DENOISER = "from gsgi.baker.trace import llvm; llvm.select(); import mitsuba_oidn; print('Open Image Denoise')"
_DECODERS = "import DracoPy; from meshoptimizer import decoder; print('Draco, meshopt')"
_WINDOW = "import moderngl_window, PIL; print('moderngl-window', moderngl_window.__version__)"
_CUDA = (
    "from gsgi.baker.over.cuda_splat import unavailable; reason = unavailable(); assert reason is None, reason; "
    "import torch; print(torch.cuda.get_device_name())"
)
_GPU = (
    "from gsgi.baker.trace.device import gpu_name, unavailable; reason = unavailable(); "
    "assert reason is None, reason; print(gpu_name())"
)
_EXTRA_BAKE = "install gsgi with its extra 'bake'"

FRAMES, BAKES = "frames", "bakes"  # what parts are needed for

_PARTS = (
    ("EGL", _GL.format("egl"), FRAMES, "apt-get install libegl1 libgl1-mesa-dri"),
    ("OSMesa", _GL.format("osmesa"), FRAMES, "apt-get install libosmesa6"),
    ("LLVM", _LLVM, BAKES, f"{_EXTRA_BAKE}; apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH"),
    ("Mitsuba", _MITSUBA, BAKES, _EXTRA_BAKE),
    ("Open3D", _OPEN3D, BAKES, f"{_EXTRA_BAKE}; apt-get install libusb-1.0-0 libgl1 libx11-6 libgomp1"),
    ("kernels", _KERNELS, BAKES, "install a C++ compiler (apt-get install g++), then gsgi again"),
    ("denoiser", _DENOISER, "", f"{_EXTRA_BAKE}; without it, bakes with --operator over need more samples"),
    ("decoders", _DECODERS, "", "for meshes compressed by Draco or meshopt: install gsgi with its extra 'decoders'"),
    ("window", _WINDOW, "", "for gsgi view: install gsgi with its extra 'view'"),
    ("GPU", _GPU, "", "not needed: without it, --device cuda does not trace, and the CPU does"),
    ("CUDA", _CUDA, "", "not needed: without it, the fit computes on the CPU"),
)


@dataclass(frozen=True)
class Check:
    """The result for one part: whether it works, and what was found in `detail`.

    `needed_for` is FRAMES, BAKES, or empty. `advice` says what to do if the part does not work.
    """

    name: str
    works: bool
    needed_for: str
    detail: str
    advice: str = ""


def examine() -> list[Check]:
    """Check every part."""
    return [_check(*part) for part in _PARTS]


def abilities(checks: Sequence[Check]) -> dict[str, bool]:
    """Whether frames can be drawn, which takes one of the OpenGL back ends, and whether bakes can be made."""
    return {
        FRAMES: any(check.works for check in checks if check.needed_for == FRAMES),
        BAKES: all(check.works for check in checks if check.needed_for == BAKES),
    }


def _check(name: str, code: str, needed_for: str, advice: str) -> Check:
    try:
        run = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return Check(
            name, False, needed_for, f"no answer within {TIMEOUT} s", "try again when this machine is less busy"
        )
    if run.returncode == 0:
        return Check(name, True, needed_for, run.stdout.strip().splitlines()[-1])
    lines = run.stderr.strip().splitlines()
    died = f"ended by signal {-run.returncode}" if run.returncode < 0 else "failed"
    return Check(name, False, needed_for, lines[-1].split(": ", 1)[-1] if lines else died, advice)
