"""Mitsuba as a ray caster: load the module with our variant, and build a Mitsuba scene from triangles."""

import os
import sys

import numpy as np

from . import llvm


def load_mitsuba():
    """The mitsuba module with our variant set. The first call takes about a second."""
    if "mitsuba" not in sys.modules:
        llvm.select()
    import mitsuba as mi

    if mi.variant() is None:
        try:
            mi.set_variant("llvm_ad_rgb")
        except ImportError as error:  # LLVM has just worked in a process of its own, which held nothing else
            raise MemoryError(f"cannot load {os.environ['DRJIT_LIBLLVM_PATH']}") from error
    return mi


def build(position: np.ndarray, triangle: np.ndarray):
    """The `mitsuba.Scene` of triangles (F, 3) uint32 over positions (V, 3) float32: one shape, geometry only."""
    mi = load_mitsuba()
    shape = mi.Mesh("triangles", vertex_count=len(position), face_count=len(triangle))
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = position.ravel()
    parameters["faces"] = np.ascontiguousarray(triangle).ravel()
    parameters.update()
    return mi.load_dict({"type": "scene", "triangles": shape})
