"""How detailed surfaces are: flat ones least, bumpy ones most, whatever their size and triangles."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.surface_detail import FEWEST, PER_SCENE, PER_SPACE, bent_share, gaussians_for
from gsgi.baker.views.importance import POINTS, ImportanceField
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.scene import Mesh, Scene


def seen(*meshes: Mesh, seed: int = 0) -> ImportanceField:
    """A field of points that are evenly spread over the meshes."""
    triangles = Triangles(Scene(meshes, (scenes.WHITE,)))
    return ImportanceField.of(triangles.draw(POINTS, np.random.default_rng(seed)))


def grid(cells: int, height) -> Mesh:
    """A square of edge 2 of `cells`^2 quads; y = height(x, z)."""
    edge = np.linspace(-1, 1, cells + 1)
    z, x = np.meshgrid(edge, edge, indexing="ij")
    position = np.stack([x, height(x, z), z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()[:, None]
    quads = corner + np.array([[0, cells + 1, 1], [1, cells + 1, cells + 2]])[:, None]
    triangle = quads.reshape(-1, 3).astype(np.uint32)
    edges = position[triangle[:, 1:]] - position[triangle[:, :1]]
    normal = np.zeros_like(position)
    for k in range(3):
        np.add.at(normal, triangle[:, k], np.cross(edges[:, 0], edges[:, 1]))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Mesh(position, normal, np.zeros((len(position), 1, 2), np.float32), triangle, 0)


def bumpy(cells: int = 60, waves: int = 8) -> Mesh:
    return grid(cells, lambda x, z: 0.1 * np.sin(waves * np.pi * x) * np.sin(waves * np.pi * z))


def scaled(meshes, factor: float) -> list[Mesh]:
    return [replace(mesh, position=np.float32(factor) * mesh.position) for mesh in meshes]


def rooms(count: int) -> list[Mesh]:
    """Boxes in a row, 3 m apart."""
    return [
        replace(mesh, position=mesh.position + np.float32([3 * k, 0, 0])) for k in range(count) for mesh in scenes.box()
    ]


def test_one_flat_wall_has_no_detail():
    floor = seen(scenes.floor())
    assert bent_share(floor) == 0
    assert gaussians_for(floor) == FEWEST


def test_each_space_has_gaussians_of_its_own():
    floor = seen(scenes.floor())
    assert gaussians_for(replace(floor, spaces=1.5)) == FEWEST
    assert gaussians_for(replace(floor, spaces=50.0)) == 50 * PER_SPACE


def test_triangles_that_lie_flat_are_no_detail():
    assert bent_share(seen(grid(60, lambda x, z: 0 * x))) == 0


def test_edges_and_bumps_are_detail():
    shares = [bent_share(seen(*meshes)) for meshes in ([scenes.floor()], scenes.box(), rooms(4), [bumpy()])]
    assert shares == sorted(set(shares))
    assert shares[-1] > 0.2
    counts = [gaussians_for(seen(*meshes)) for meshes in ([scenes.floor()], rooms(4), [bumpy()])]
    assert counts == sorted(set(counts))
    assert counts[-1] < PER_SCENE


def test_two_walls_back_to_back_are_flat():
    """The neighbour beyond a thin wall is none that the light leaks to."""
    wall = scenes.floor(), scenes.floor(height=-1e-4)
    back = replace(wall[1], normal=-wall[1].normal, triangle=wall[1].triangle[:, ::-1].copy())
    assert bent_share(seen(wall[0], back)) < 0.02


def test_edges_count_by_their_length():
    """A box has edges of 12 x 2 m on 24 m^2: the share is that of points within a neighbour's distance of one."""
    spacing = np.sqrt(24 / POINTS)
    share = bent_share(seen(*scenes.box()))
    assert 0.2 < share / (12 * 2 * 2 * spacing / 24) < 1.0


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_the_unit_of_length_does_not_matter(factor):
    share = bent_share(seen(*scenes.box()))
    assert bent_share(seen(*scaled(scenes.box(), factor))) == pytest.approx(share, rel=0.02)


def test_the_same_seed_gives_the_same_number_and_another_nearly_so():
    counts = [gaussians_for(seen(*rooms(4), seed=seed)) for seed in (0, 0, 1, 2)]
    assert counts[0] == counts[1]
    # 4,096 probes: a share of 4 % is met to some 7 %.
    assert max(counts) < 1.25 * min(counts)
