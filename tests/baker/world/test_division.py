"""Boxes that divide a scene."""

import numpy as np
import pytest
import scenes

from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.world.division import FAR_SIGHTS, MARGIN, automatic_size, divide
from gsgi.runtime.errors import UsageError
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.boxes import neighbours, overlap


def test_boxes_have_equal_edges_up_to_the_size_and_tile_the_scene():
    room = Triangles(scenes.furnace())
    division = divide(room, 1.5)
    edges = division.boxes[:, 1] - division.boxes[:, 0]
    np.testing.assert_allclose(edges, edges[0, 0], rtol=1e-9)
    assert 1 < edges[0, 0] < 1.01  # two halves of 2 m and a little
    assert len(division.boxes) == 8
    assert overlap(division.boxes) is None
    assert all(len(near) == 3 for near in neighbours(division.boxes))
    assert division.margin == pytest.approx(MARGIN * edges.min())
    assert len(divide(room, 5).boxes) == 1
    np.testing.assert_allclose(division.area, 3, rtol=0.01)


def test_boxes_without_a_surface_are_left_out():
    room = Triangles(scenes.furnace())
    division = divide(room, 0.7)
    assert len(division.boxes) == 26  # all of 27 but the middle one
    flat = divide(Triangles(Scene((scenes.floor(2.0),), (scenes.WHITE,))), 1.0)
    assert len(flat.boxes) == 25
    assert flat.area[flat.largest] == flat.area.max()
    assert (flat.boxes[:, 1] > flat.boxes[:, 0]).all()


def test_too_many_sectors_are_refused():
    with pytest.raises(UsageError, match=r"--sectors 0\.01: makes 8120601 sectors, and a world has at most 4096"):
        divide(Triangles(scenes.furnace()), 0.01)


def test_sectors_are_as_wide_as_people_see_far():
    small, large = (automatic_size(Triangles(Scene(tuple(scenes.box(half)), (scenes.WHITE,))), 0) for half in (1, 10))
    assert large == pytest.approx(10 * small, rel=0.1)
    assert FAR_SIGHTS * 0.5 < small < FAR_SIGHTS * 1.8
