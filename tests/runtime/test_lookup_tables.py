"""Tables for shaders: the same, in whatever pieces they are made."""

import numpy as np
from surface_frames import room, surface_gaussians

from gsgi.runtime import lookup_tables
from gsgi.runtime.gaussians import Bake, SurfaceBlend


def test_tables_do_not_depend_on_the_size_of_pieces(monkeypatch):
    bake = Bake(surface_gaussians(room(), 300), SurfaceBlend(), coarse=surface_gaussians(room(), 20, 2))
    whole = lookup_tables.lookup_tables(bake)
    monkeypatch.setattr(lookup_tables, "PIECE", 7)
    for ours, theirs in zip(lookup_tables.lookup_tables(bake), whole, strict=True):
        np.testing.assert_array_equal(ours, theirs)
