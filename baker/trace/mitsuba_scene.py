"""Mitsuba as a ray caster: load the module with our variant, and build a Mitsuba scene from triangles."""

import os
import sys
from collections.abc import Iterable

import numpy as np

from gsgi.baker.interrupts import uninterrupted

from . import llvm
from .device import VARIANTS, device

ALIGNMENT = 128  # bytes; that of Dr.Jit's own arrays is no wider


def load_mitsuba():
    """The mitsuba module with the variant of our `device` set. The first call takes about a second."""
    ours = "mitsuba" not in sys.modules
    if ours and device() == "cpu":
        llvm.select()
    with uninterrupted():
        return _loaded(ours)


def _loaded(ours: bool):
    """The module, after `llvm.select` where it is `ours` to load. Interrupted, it could not be loaded again."""
    if ours and "DRJIT_CACHE_DIR" not in os.environ:
        _import_drjit_in_silence()
    import mitsuba as mi

    if mi.variant() is None:
        try:
            mi.set_variant(VARIANTS[device()])
        except ImportError as error:
            if not ours or device() != "cpu":
                raise
            # LLVM has just worked in a process of its own, which held nothing else.
            raise MemoryError(f"cannot load {os.environ['DRJIT_LIBLLVM_PATH']}") from error
    return mi


def _import_drjit_in_silence() -> None:
    """Where HOME is missing or read-only, Dr.Jit keeps no kernels on disk, and would print that on stderr."""
    stderr = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        import drjit  # noqa: F401
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)


def on_device(kind: type, values: np.ndarray):
    """The numbers of an array as a flat array of Dr.Jit's type `kind`, float32 or uint32.

    A CPU reads arrays of NumPy where they are, and a kernel is compiled for how they are aligned. That would differ
    from run to run, and no kernel on disk would be found again: so all have the same alignment.
    """
    values = np.asarray(values, np.uint32 if kind is load_mitsuba().UInt32 else np.float32).ravel()
    room = np.empty(values.nbytes + ALIGNMENT, np.uint8)
    start = -room.ctypes.data % ALIGNMENT
    aligned = room[start : start + values.nbytes].view(values.dtype)
    aligned[:] = values
    return kind(aligned)


def build(
    position: np.ndarray, triangle: np.ndarray, groups: Iterable[tuple[np.ndarray, dict[int, np.ndarray]]] = (),
    beside=None,
):  # fmt: skip
    """The `mitsuba.Scene` of triangles (F, 3) uint32 over positions (V, 3) float32: one shape, geometry only.

    Each of the `groups`, triangles and the matrices (4, 4) of places by their numbers, is in memory once. Each of its
    places is an instance, a shape whose id is the number. A kernel for a GPU can trace several scenes if each but the
    first is built `beside` that.
    """
    mi = load_mitsuba()
    shapes = {} if beside is None else {"beside": beside}
    shapes |= {"triangles": _mesh(position, triangle)} if len(triangle) else {}
    for name, (own, places) in enumerate(groups):
        used, own = np.unique(own, return_inverse=True)
        mesh = _mesh(position[used], own.reshape(-1, 3).astype(np.uint32))
        shapes[f"group {name}"] = {"type": "shapegroup", "triangles": mesh}
        for number, matrix in places.items():
            group = {"type": "ref", "id": f"group {name}"}
            shapes[str(number)] = {"type": "instance", "to_world": mi.ScalarTransform4f(matrix), "group": group}
    return mi.load_dict({"type": "scene", **shapes})


def _mesh(position: np.ndarray, triangle: np.ndarray):
    shape = load_mitsuba().Mesh("triangles", vertex_count=len(position), face_count=len(triangle))
    parameters = load_mitsuba().traverse(shape)
    parameters["vertex_positions"] = position.ravel()
    parameters["faces"] = np.ascontiguousarray(triangle).ravel()
    parameters.update()
    return shape
