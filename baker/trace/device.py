"""Which processor traces paths: this machine's CPU, through LLVM, or its NVIDIA GPU, through CUDA and OptiX.

Mitsuba knows one for a whole process. A path makes the same decisions on both but for rounding, so the light of a bake
differs by less than its noise, and its bytes differ.
"""

import ctypes
import os
import subprocess
import sys

from gsgi.runtime.errors import UnsupportedError, UsageError

DEVICES = ("auto", "cpu", "cuda")
VARIANTS = {"cpu": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}  # of Mitsuba
TIMEOUT = 120.0  # s, for the probe

# A child process tries it, because a driver that does not fit can end the process.
_PROBE = """
import mitsuba as mi
mi.set_variant("cuda_ad_rgb")
scene = mi.load_dict({"type": "scene", "wall": {"type": "rectangle"}})
print(scene.ray_test(mi.Ray3f([0, 0, 1], [0, 0, -1]))[0])
"""
_NAME_BYTES = 256
_DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"

_chosen: str | None = None


def choose(name: str) -> str:
    """Trace on `name` (of DEVICES) from now on; `auto` is a GPU that works, or else the CPU. Returns "cpu" or "cuda".

    Call it before anything is traced. Raises UnsupportedError where the GPU cannot trace, and UsageError for another
    name or once paths are traced on the other device.
    """
    global _chosen
    if name not in DEVICES:
        raise UsageError(f"device: expected one of {', '.join(DEVICES)}, got {name!r}")
    reason = None if name == "cpu" else unavailable()
    if name == "cuda" and reason:
        raise UnsupportedError(f"no GPU can trace here: {reason}")
    wanted = "cpu" if name == "cpu" or reason else "cuda"
    loaded = sys.modules.get("mitsuba")
    if loaded and loaded.variant() not in (None, VARIANTS[wanted]):
        raise UsageError(f"device: Mitsuba already traces with {loaded.variant()} in this process")
    _chosen = wanted
    return wanted


def device() -> str:
    """The device that traces: "cpu", unless `choose` has chosen another."""
    return _chosen or "cpu"


def unavailable() -> str | None:
    """Why no GPU can trace on this machine, or None if one can. Takes a second where there is an NVIDIA driver."""
    if not gpu_name():
        return "the NVIDIA driver finds no GPU, or there is none"
    try:
        probe = subprocess.run([sys.executable, "-P", "-c", _PROBE], capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return f"a test of OptiX did not end within {TIMEOUT:.0f} s"
    if probe.returncode == 0 and probe.stdout.strip().endswith("True"):
        return None
    lines = probe.stderr.strip().splitlines()
    return f"a test of OptiX failed: {lines[-1] if lines else f'it ended with code {probe.returncode}'}"


def gpu_name() -> str | None:
    """The name of the first GPU that the NVIDIA driver knows; None if there is none."""
    try:
        driver = ctypes.CDLL(_DRIVER)
    except OSError:
        return None
    count, gpu, name = ctypes.c_int(), ctypes.c_int(), ctypes.create_string_buffer(_NAME_BYTES)
    if driver.cuInit(0) or driver.cuDeviceGetCount(ctypes.byref(count)) or not count.value:
        return None
    if driver.cuDeviceGet(ctypes.byref(gpu), 0) or driver.cuDeviceGetName(name, _NAME_BYTES, gpu):
        return None
    return name.value.decode(errors="replace")


def title() -> str:
    """The device that traces, in words."""
    if device() == "cuda":
        return f"{gpu_name()} (CUDA)"
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity else os.cpu_count()
    return f"CPU, {cores} cores"
