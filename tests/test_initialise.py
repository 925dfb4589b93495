"""The Gaussians that a fit starts from."""

import numpy as np
import pytest
import scenes

from gsgi.baker.initialise import FLATNESS, from_surface
from gsgi.baker.surface_points import Triangles
from gsgi.runtime import constants


@pytest.fixture(scope="module")
def room() -> Triangles:
    return Triangles(scenes.furnace())


def test_first_gaussians_lie_flat_on_the_surface(room):
    points = room.sample(500, seed=0)
    light = np.full((500, 3), 0.25, np.float32)
    gaussians = from_surface(points.position, points.normal, light, sh_degree=1)
    x, y, z, w = gaussians.rotation.T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    np.testing.assert_allclose(axis, points.normal, atol=1e-5)
    np.testing.assert_allclose(gaussians.scale[:, 2], FLATNESS * gaussians.scale[:, 0], rtol=1e-6)
    spacing = np.sqrt(24 / 500)
    assert 0.5 * spacing < gaussians.scale[:, 0].mean() < 1.5 * spacing
    np.testing.assert_allclose(gaussians.sh[:, 0] * constants.SH_C0, 0.25, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_points_still_get_a_finite_scale(room, count):
    points = room.sample(count, 0)
    gaussians = from_surface(points.position, points.normal, np.ones((count, 3), np.float32), 0)
    assert len(gaussians) == count
    assert np.isfinite(gaussians.scale).all()
    assert (gaussians.scale > 0).all()
