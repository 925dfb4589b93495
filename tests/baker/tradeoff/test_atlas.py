"""The atlas: every texel lies on the surface of its triangle, and charts have the density that is asked for."""

import numpy as np
import pytest
import scenes

from gsgi.baker.tradeoff.atlas import Atlas, rasterise, unwrap
from gsgi.runtime.scene import Scene

DENSITY = 24.0


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return unwrap(Scene(tuple(scenes.box()), (scenes.WHITE,)), DENSITY)


def test_charts_have_the_density_that_is_asked_for(atlas):
    edges = atlas.triangle[:, [0, 1]]
    metres, texels = (
        np.linalg.norm(np.diff(values[edges], axis=1)[:, 0], axis=1) for values in (atlas.position, atlas.uv)
    )
    np.testing.assert_allclose(texels / metres, DENSITY, rtol=0.05)
    assert (atlas.uv >= 0).all()
    assert (atlas.uv <= [atlas.width, atlas.height]).all()


def test_texels_lie_on_their_surface(atlas):
    texels = rasterise(atlas)
    corners = atlas.triangle[texels.triangle]
    position = (texels.weight[..., None] * atlas.position[corners]).sum(axis=1)
    np.testing.assert_allclose(np.abs(position).max(axis=1), 1, atol=1e-5)
    uv = (texels.weight[..., None] * atlas.uv[corners]).sum(axis=1)
    np.testing.assert_allclose(uv, np.stack([texels.column, texels.row], axis=1) + 0.5, atol=1e-3)


def test_texels_cover_the_area_once(atlas):
    texels = rasterise(atlas)
    assert len(texels.row) == pytest.approx(6 * 4 * DENSITY**2, rel=0.05)
    assert len(np.unique(texels.row * atlas.width + texels.column)) == len(texels.row)


def test_a_triangle_smaller_than_a_texel_gets_one():
    uv = np.float32([[2.6, 3.6], [2.7, 3.6], [2.6, 3.7]])
    position = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    one = np.zeros(3, np.int64)
    texels = rasterise(Atlas(position, position, uv, np.array([[0, 1, 2]]), one, one, 8, 8))
    assert (texels.row.tolist(), texels.column.tolist(), texels.triangle.tolist()) == ([3], [2], [0])
    assert (texels.weight >= 0).all()
    assert texels.weight.sum() == pytest.approx(1)
