"""Viewpoints, and what they see."""

import numpy as np
import scenes

from gsgi.baker.views import viewpoints
from gsgi.baker.views.free_space import FreeSpace
from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.views.visibility import Lens, sides, sight_lines
from gsgi.runtime.scene import Material, Scene


def test_lines_run_from_all_viewpoints_to_all_samples_however_these_are_added(monkeypatch):
    monkeypatch.setattr(viewpoints, "VIEWPOINTS", 24)
    monkeypatch.setattr(viewpoints, "MORE_VIEWPOINTS", 8)
    triangles = Triangles(Scene(scenes.box(), (Material("wall"),)))
    rng = np.random.default_rng(0)
    first, second = (sides(triangles.draw(count, rng)) for count in (60, 40))
    free = FreeSpace(triangles, [], first.points, rng)
    eyes = viewpoints.Viewpoints(triangles, free, Lens(1.2, 64), rng)
    for samples in (first, second[np.arange(len(second)) % 2 == 0], second[np.arange(len(second)) % 2 == 1]):
        eyes.look_at(samples)
    assert len(eyes.position) > 24
    assert len(eyes.samples) == 100
    expected = sight_lines(triangles, eyes.position, eyes.samples.points, eyes.samples.extent)
    assert len(expected.side) > 1000
    for one, other in zip(eyes.lines, expected, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
