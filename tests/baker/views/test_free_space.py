"""Places where viewpoints may lie."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.views import free_space
from gsgi.baker.views.free_space import FreeSpace
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.scene import Scene


@pytest.mark.parametrize("most", [1, 20, 1000])
def test_no_more_places_are_looked_for_than_asked_for(most, monkeypatch):
    """They are the first of all that there are, and the numbers that are drawn do not depend on it."""
    triangles = Triangles(scenes.furnace())
    points = triangles.draw(200, np.random.default_rng(0))
    free = FreeSpace(triangles, [], points, np.random.default_rng(1))
    looked = []
    look_around = free_space.look_around
    monkeypatch.setattr(free_space, "AT_ONCE", 16)
    monkeypatch.setattr(free_space, "look_around", lambda t, p: (looked.append(len(p)), look_around(t, p))[1])
    first, second = np.random.default_rng(2), np.random.default_rng(2)
    every, of = free.draw(points, triangles.diagonal, first)
    looks = sum(looked)
    looked.clear()
    some, of_some = free.draw(points, triangles.diagonal, second, most)
    assert 20 < len(every) <= 200
    assert np.array_equal(some, every[:most])
    assert np.array_equal(of_some, of[:most])
    before = ((every - points.position[of]) * points.normal[of]).sum(axis=1)
    assert (before > 0).all()
    assert (sum(looked) < looks) == (most < len(every))
    assert first.random() == second.random()


def test_a_camera_among_things_that_are_inside_out_tells_that_people_are_there():
    """Crates in a room show their backs."""
    crate = [replace(mesh, position=np.float32(0.35) * mesh.position) for mesh in scenes.box()]
    crates = [
        replace(mesh, position=mesh.position + np.float32([x, 0.0, z]))
        for x, z in ((-0.6, -0.6), (0.6, -0.6), (-0.6, 0.6))
        for mesh in crate
    ]
    triangles = Triangles(Scene((*scenes.box(), *crates), (scenes.WHITE,)))
    points, place = triangles.draw(200, np.random.default_rng(0)), np.array([[0.3, 0.2, 0.6], [1.5, 0.0, 0.0]])
    cameras = [], [scenes.inside_camera()]
    alone, given = (FreeSpace(triangles, own, points, np.random.default_rng(1)) for own in cameras)
    assert alone.faces_fronts(place).tolist() == [False, False]
    assert given.faces_fronts(place).tolist() == [True, False]  # not outside the room
