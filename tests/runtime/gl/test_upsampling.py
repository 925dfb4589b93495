"""The `surface` operator at half, a third and a quarter of the resolution."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import scenes
from surface_frames import draw, nothing, one, room, seen_points, surface_gaussians

from gsgi.runtime.camera import look_at
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer, pixels
from gsgi.runtime.scene import Scene

SIZE = 160, 120
FRONT = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)
SCALES = pytest.mark.parametrize("splat_scale", [2, 3, 4])


def lit(scene: Scene, light) -> Gaussians:
    """Gaussians on the surfaces of a scene, `light` a function of position (N, 3) and the surface's normal (N, 3)."""
    fine = surface_gaussians(scene, 2000)
    x, y, z, w = fine.rotation.T
    normal = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    return replace(fine, sh=(light(fine.position, normal) / 0.28209479)[:, None].astype(np.float32))


def wall(z, low, high, material=0):
    """A rectangle that faces +Z."""
    return scenes.quad(
        [(low[0], low[1], z), (high[0], low[1], z), (high[0], high[1], z), (low[0], high[1], z)], material
    )


@SCALES
def test_a_smooth_field_is_kept(gl, splat_scale):
    def light(position, normal):
        return 0.5 + 0.3 * np.sin(2 * position + position[:, ::-1]) + 0.1 * normal

    fine, scene = lit(room(), light), room()
    size = 320, 240
    full = draw(gl, fine, scene=scene, size=size)[0]
    low = draw(gl, fine, scene=scene, size=size, splat_scale=splat_scale)[0]
    error = np.abs(low - full).max(axis=-1)
    # An 8-bit image of this light shows steps of 1/255. Single pixels in corners have no point of their wall near.
    assert np.median(error) < 0.5 / 255
    assert (error > 2 / 255).mean() < {2: 0.0005, 3: 0.003, 4: 0.008}[splat_scale]


@SCALES
def test_no_leak_between_walls_that_meet(gl, splat_scale):
    """Each wall has a colour channel of its own."""
    scene = Scene(tuple(scenes.box()), (scenes.WHITE,))
    fine = lit(scene, lambda position, normal: np.abs(normal) * [1.0, 1.0, 1.0])
    low, _, normal = draw(gl, fine, scene=scene, size=SIZE, splat_scale=splat_scale)
    assert np.abs(low - np.abs(normal)).max() < 1e-3


@SCALES
def test_no_leak_across_a_depth_edge(gl, splat_scale):
    """A red card before a blue wall, both facing the camera."""
    scene = Scene((wall(-3.0, (-4, -4), (4, 4)), wall(-2.0, (-0.53, -0.47), (0.41, 0.59))), (scenes.WHITE,))
    fine = lit(scene, lambda position, _: np.where(position[:, 2:] > -2.5, [1.0, 0, 0], [0, 0, 1.0]))
    low, depth, _ = draw(gl, fine, scene=scene, camera=FRONT, size=SIZE, splat_scale=splat_scale)
    expected = np.where(depth[..., None] < 2.5, [1.0, 0, 0], [0, 0, 1.0])
    assert np.abs(low - expected).max() < 1e-3


@SCALES
@pytest.mark.parametrize("behind", [True, False])
def test_thin_things_do_not_go_black(gl, splat_scale, behind):
    """Wires of about one pixel, before a wall or before nothing."""
    x = np.linspace(-1.0, 1.0, 9)
    wires = [wall(-2.0, (a, -2), (a + 0.02, 2)) for a in x]
    back = [wall(-4.0, (-9, -9), (9, 9))] if behind else []
    scene = Scene((*wires, *back), (scenes.WHITE,))
    coarse = one((0, 0, -2), scale=(9, 9, 9), light=0.5)
    low, depth, _ = draw(gl, nothing(), coarse, scene, FRONT, size=SIZE, splat_scale=splat_scale)
    assert ((depth > 0) & (depth < 3)).sum() > 500
    assert np.allclose(low[depth > 0], 0.5, rtol=1e-3)
    assert not low[depth == 0].any()


@SCALES
def test_the_coarse_level_fills_gaps_without_a_seam(gl, splat_scale):
    """One fine Gaussian fades below the floor in the middle of a wall; beside the wall is nothing."""
    scene = Scene((wall(-3.0, (-1.6, -1.1), (1.6, 1.1)),), (scenes.WHITE,))
    fine = one((0, 0, -3), (0.5, 0.5, 0.1), light=0.9, rotation=(0, 0, 0, 1))
    coarse, blend = one((0, 0, -3), scale=(9, 9, 9), light=0.3), SurfaceBlend(floor=0.5)
    full, low = (draw(gl, fine, coarse, scene, FRONT, blend, SIZE, scale)[0] for scale in (1, splat_scale))
    assert full[full > 0].min() == pytest.approx(0.3, rel=1e-3)
    assert ((full > 0.4) & (full < 0.8)).mean() > 0.02
    # Where the fine level reaches the floor, light bends: from 0.04 per pixel to 0, within half the points' spacing.
    assert np.abs(low - full).max() < 0.04 * splat_scale / 2


@SCALES
def test_a_wire_keeps_its_own_light(gl, splat_scale):
    """One pixel wide, dark before a bright wall: of both surfaces a point is near any pixel."""
    scene = Scene((wall(-2.0, (-0.01, -2), (0.01, 2)), wall(-4.0, (-9, -9), (9, 9))), (scenes.WHITE,))
    fine = Gaussians(*(
        np.concatenate([getattr(a, n), getattr(b, n)])
        for a, b in [(one((0, 0, -2), (9, 9, 0.1), light=0.2, rotation=(0, 0, 0, 1)),
                      one((0, 0, -4), (9, 9, 0.1), light=0.9, rotation=(0, 0, 0, 1)))]
        for n in ("position", "rotation", "scale", "opacity", "sh")
    ))  # fmt: skip
    low, depth, _ = draw(gl, fine, scene=scene, camera=FRONT, size=SIZE, splat_scale=splat_scale)
    assert (depth < 3).sum() >= SIZE[1]
    assert np.allclose(low, np.where(depth[..., None] < 3, 0.2, 0.9), rtol=1e-3)


@SCALES
def test_only_squares_that_show_one_surface_are_smooth(gl, splat_scale):
    """A card before a wall, a ledge half a percent before the card, and nothing beside the wall."""
    card, ledge = wall(-2.0, (-0.5, -0.5), (0.5, 0.5)), wall(-1.99, (0.2, -0.4), (0.213, 0.4))
    scene = Scene((wall(-3.0, (-1.2, -1.2), (1.2, 1.2)), card, ledge), (scenes.WHITE,))
    fine = lit(scene, lambda position, _: np.ones_like(position))
    renderer = DeferredRenderer(gl, scene, Bake(fine, SurfaceBlend(), coarse=nothing()), *SIZE, splat_scale)
    renderer.render(FRONT)
    depth, filled = renderer.read("depth"), pixels(renderer.splats._splats.targets.filled)[..., 3]
    renderer.release()
    smooth = np.argwhere(filled[::-1] < 0)
    assert len(smooth) > 0.2 * filled.size
    rows = depth[::-1]
    for row, column in smooth:
        square = rows[row * splat_scale : (row + 2) * splat_scale, column * splat_scale : (column + 2) * splat_scale]
        assert square.min() > 0, (row, column)
        assert np.ptp(square) < 1e-3, (row, column)


@SCALES
@pytest.mark.parametrize("size", [(7, 5), (33, 31), (1, 1), (2, 97)])
def test_size_may_be_odd(gl, splat_scale, size):
    fine = lit(room(), lambda position, _: np.full_like(position, 0.7))
    low = draw(gl, fine, scene=room(), size=size, splat_scale=splat_scale)[0]
    assert low.shape == (*size[::-1], 3)
    assert np.allclose(low, 0.7, rtol=1e-3)


@pytest.mark.parametrize("size", [SIZE, (159, 121)])
def test_the_points_lie_where_the_upsampling_expects_them(gl, size):
    """A linear field over a wall is reproduced but for what single Gaussians add to it."""
    scene = Scene((wall(-2.0, (-4, -4), (4, 4)),), (scenes.WHITE,))
    fine = lit(scene, lambda position, _: 1 + 0.2 * position)
    depth = draw(gl, fine, scene=scene, camera=FRONT, size=size)[1]
    expected = 1 + 0.2 * seen_points(depth, FRONT)
    errors = [
        np.abs(draw(gl, fine, scene=scene, camera=FRONT, size=size, splat_scale=s)[0] - expected)[8:-8, 8:-8].mean()
        for s in (1, 2, 3, 4)
    ]
    assert max(errors) < 1.5 * errors[0] + 1e-3


@SCALES
def test_specks_are_read_at_the_points(gl, splat_scale):
    """Smaller than a pixel of the target: what is read of them is what the oracle says of the points read."""
    scene = Scene((wall(-2.0, (-4, -4), (4, 4)),), (scenes.WHITE,))
    fine = lit(scene, lambda position, _: np.ones_like(position))
    fine = replace(fine, scale=fine.scale * np.float32([0.2, 0.2, 1]))
    for size in (SIZE, (157, 119)):
        bake = Bake(fine, SurfaceBlend(), coarse=nothing())
        renderer = DeferredRenderer(gl, scene, bake, *size, splat_scale)
        renderer.render(FRONT)
        targets = renderer.splats._splats.targets
        position, plane, sums = (
            np.frombuffer(texture.read(), np.float32).reshape(-1, 4)
            for texture in (targets.position, targets.plane, targets.filled)
        )
        points = position[:, :3], plane[:, :3].astype(float)
        expected = oracle.read_surface(fine, nothing(), bake.blend, *points)[0][0]
        assert (expected[:, 3] > 0).mean() > 0.1
        expected[:, 3] = np.maximum(expected[:, 3], bake.blend.floor * (expected[:, 3] > 0))
        np.testing.assert_allclose(sums[:, :3], expected[:, :3], rtol=1e-3, atol=1e-4)
        np.testing.assert_allclose(np.abs(sums[:, 3]), expected[:, 3], rtol=1e-3, atol=1e-4)
        renderer.release()
