"""Views from outside: only where something opens to the outside."""

import numpy as np
import pytest
import scenes
from small_tasks import place_quickly

from gsgi.baker.views.coverage import seen_by
from gsgi.baker.views.exterior import INSIDE_MIN
from gsgi.baker.views.placement import HELD_OUT, place
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.scene import Scene


@pytest.fixture(scope="module", autouse=True)
def quick():
    with pytest.MonkeyPatch.context() as patch:
        place_quickly(patch.setattr)
        yield


def outside(meshes, size: int = 48) -> np.ndarray:
    """Positions (N, 3) of the cameras that stand beside the box of edge 2 around the origin."""
    placement = place(Triangles(Scene(tuple(meshes), (scenes.WHITE,))), {}, size, seed=0).without_dark(set())
    cameras = [*placement.fitted.values(), *placement.held_out.values()]
    position = np.array([camera.position for camera in cameras])
    beside = (np.abs(position) > 1).any(axis=1)
    assert len(placement.held_out) == HELD_OUT
    if beside.any():
        assert (np.abs([camera.position for camera in placement.held_out.values()]) > 1).any()
    return position[beside]


def test_a_closed_room_is_not_looked_at_from_outside():
    assert len(outside(scenes.box())) == 0


@pytest.mark.parametrize(("axis", "sign"), [(2, 1.0), (0, -1.0), (1, 1.0)])
def test_an_open_side_is_looked_in_by_several_views(axis, sign):
    walls = [mesh for mesh in scenes.box() if not np.allclose(mesh.position[:, axis], sign)]
    viewpoints = outside(walls)
    assert len(viewpoints) >= 4
    assert (sign * viewpoints[:, axis] > 1).all()
    assert (viewpoints[:, 1] >= -1).all()


def test_hardly_anything_that_views_see_is_the_outer_wall_around_a_window():
    """A wall of 5 cm with a window of edge 1; its outer side faces the void."""
    walls = [mesh for mesh in scenes.box() if not np.allclose(mesh.position[:, 2], 1)]
    for x, y in (((-1, -0.5), (-1, 1)), ((0.5, 1), (-1, 1)), ((-0.5, 0.5), (-1, -0.5)), ((-0.5, 0.5), (0.5, 1))):
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        walls += [scenes.quad([(*p, 1.0) for p in corners[::-1]]), scenes.quad([(*p, 1.05) for p in corners])]
    triangles = Triangles(Scene(tuple(walls), (scenes.WHITE,)))
    placement, points = place(triangles, {}, 48, seed=0), triangles.draw(4096, np.random.default_rng(0))
    outer = points.position[:, 2] > 1.04
    for name, camera in (placement.fitted | placement.held_out).items():
        seen = seen_by(triangles, [camera], points) > 0
        assert seen[outer].sum() <= (1 - INSIDE_MIN) * seen.sum(), name
