"""The work of the CPU on Gaussians in each frame: find those in view, and sort them."""

import numpy as np

from gsgi.runtime.camera import look_at
from gsgi.runtime.gaussians import OverBlend
from gsgi.runtime.gl.cull import in_view
from gsgi.runtime.gl.sort import visible_order

from .splats import fastest

COUNTS = 10_000, 100_000, 1_000_000


def order() -> list[dict]:
    """Milliseconds of `cull` for `surface` and `sort` for `over`, nine in ten Gaussians in view; fastest of 12."""
    pinhole = look_at(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 0.8, 0.1).pinhole(1280, 720)
    rows, rng = [], np.random.default_rng(0)
    for count in COUNTS:
        position = rng.uniform(-2, 2, (3, count)).astype(np.float32)
        radius = np.full(count, 0.02, np.float32)
        calls = {
            "cull": lambda p=position, r=radius: in_view(p, r, pinhole),
            "sort": lambda p=position, r=radius: visible_order(p, pinhole, OverBlend(0.1), r),
        }
        ms = {name: round(1e3 * seconds, 2) for name, seconds in fastest(calls).items()}
        rows.append({"gaussians": count, "in_view": len(calls["cull"]()), "cull_ms": ms["cull"], "sort_ms": ms["sort"]})
    return rows
