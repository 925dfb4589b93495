"""B read at surfaces against the numpy oracle."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import scenes
from surface_frames import BLEND, CAMERA, NAMES, SIZE, UP, draw, nothing, one, room, seen_points, surface_gaussians

from gsgi.runtime.camera import look_at
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Mesh, Scene, Texture, TextureSlot

# B is stored in halves, of 11 bits; sums and weights are floats, off by far less.
TOLERANCE = 1e-3


def repeated(gaussians, count) -> Gaussians:
    return Gaussians(*(np.repeat(getattr(gaussians, n), count, axis=0) for n in NAMES))


def assert_equals_oracle(gl, fine, coarse=None, camera=CAMERA, blend=BLEND, scene=None, atol=1e-6):
    indirect, depth, normal = draw(gl, fine, coarse, scene, camera, blend)
    seen = depth > 0
    expected = np.zeros(indirect.shape)
    points = seen_points(depth, camera)[seen], normal[seen].astype(float)
    sums, expected[seen] = oracle.read_surface(fine, nothing() if coarse is None else coarse, blend, *points)
    # Where the sum of weights is next to nothing, so are its digits: the mean is anything in between.
    clear = ~seen
    clear[seen] = ((sums[..., 3] > 1e-8) | (sums[..., 3] == 0)).all(axis=0)
    assert clear.mean() > 0.95
    np.testing.assert_allclose(indirect[clear], expected[clear], rtol=TOLERANCE, atol=atol)
    return indirect


def test_what_a_bake_makes(gl):
    fine, coarse = surface_gaussians(room(), 1000), oracle.random_gaussians(30, 2, seed=1)
    assert assert_equals_oracle(gl, fine, coarse, scene=room()).all()


def test_recorded_parameters_are_used(gl):
    blend = SurfaceBlend(cutoff=0.3, sharpness=1, floor=0.2)
    assert_equals_oracle(gl, oracle.random_gaussians(100, 0, 9), oracle.random_gaussians(30, 1, 8), blend=blend)


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4, 1.2, np.pi / 2, 2.5])
@pytest.mark.parametrize("scale", [(0.3, 0.02, 0.02), (0.3, 0.3, 1e-2), (2, 0.4, 0.1), (0.1, 9, 0.1), (30, 30, 0.05)])
def test_ellipsoids_of_every_orientation_are_read(gl, turn, scale):
    """Small ones, ones that reach through the eye's plane, and ones that hold the eye."""
    spin = 0, np.sin(turn / 2) * 0.6, np.sin(turn / 2) * 0.8, np.cos(turn / 2)
    for position in ((0, -0.9, -0.5), (-1, 0.2, 0.5), CAMERA.position, (0.3, -0.2, 1.4), (0.9, 0.9, -0.9)):
        assert_equals_oracle(gl, nothing(), one(position, scale, rotation=spin))


def test_gaussians_around_the_eye_are_read_too(gl):
    """Gaussians all around the camera, many across its plane."""
    fine = oracle.random_gaussians(300, 0, seed=3)
    rng = np.random.default_rng(4)
    around = (CAMERA.position + rng.normal(size=(300, 3)) * 0.5).astype(np.float32)
    assert_equals_oracle(gl, nothing(), replace(fine, position=around))


ABOVE = scenes.above_camera()
FLOOR = Scene((scenes.floor(20.0),), (scenes.WHITE,))


@pytest.mark.parametrize(
    ("eye", "yfov", "thickness"), [((0, 18, 0), 0.3, 1e-4), ((-5, 11, 7), 0.3, 1e-4), ((0, 400, 0), 0.01, 0.05)]
)
def test_a_flat_gaussian_covers_the_wall_it_lies_on_from_afar(gl, eye, yfov, thickness):
    """Thinner than a step of the depth buffer there: 2 mm at 18 m, 1 m at 400 m, with the near plane at 1 cm."""
    camera = look_at(np.array(eye, float), np.zeros(3), np.array([0.0, 0.0, -1.0]), yfov, 0.01)
    fine = one(scale=(1, 1, thickness))
    indirect, depth, normal = draw(gl, fine, scene=FLOOR, camera=camera)
    points = seen_points(depth, camera).reshape(-1, 3), normal.reshape(-1, 3).astype(float)
    sums, _ = oracle.read_surface(fine, nothing(), BLEND, *points)
    inside = sums[0, :, 3].reshape(depth.shape) > BLEND.floor
    assert inside.sum() > 500
    assert np.allclose(indirect[inside], 1, rtol=TOLERANCE)


@pytest.mark.parametrize("splat_scale", [1, 2, 3, 4])
def test_no_light_where_there_is_no_surface_or_no_gaussian(gl, splat_scale):
    """The eye lies inside the Gaussian, and so do the sky's pixels as far as they lie anywhere."""
    tile = Scene((scenes.floor(0.5),), (scenes.WHITE,))
    giant = one(scale=(99, 99, 99))
    renderer = DeferredRenderer(gl, tile, Bake(giant, BLEND, coarse=giant), *SIZE, splat_scale)
    renderer.render(ABOVE)
    depth, texels = renderer.read("depth"), np.frombuffer(renderer.splats.indirect.read(), np.float16)
    renderer.release()
    lit = (texels.reshape(SIZE[1], SIZE[0], 4)[::-1, :, :3] > 0).all(axis=-1)
    assert 0 < lit.mean() < 0.5
    assert np.array_equal(lit, depth > 0)
    for gaussians in (nothing(), one((0, 99, 0))):
        assert not draw(gl, gaussians, scene=tile, camera=ABOVE, splat_scale=splat_scale)[0].any()


@pytest.mark.parametrize("splat_scale", [1, 2, 3, 4])
def test_the_coarse_level_fills_gaps_alone(gl, splat_scale):
    """The light at each point is the oracle's, whether or not the fine level weighs less than the floor there."""
    scene, coarse, blend = room(), oracle.random_gaussians(30, 2, seed=1), SurfaceBlend(floor=2.0)
    fine = surface_gaussians(scene, 150)
    renderer = DeferredRenderer(gl, scene, Bake(fine, blend, coarse=coarse), *SIZE, splat_scale)
    renderer.render(CAMERA)
    targets = renderer.splats._splats.targets
    position, plane = (
        np.frombuffer(texture.read(), np.float32).reshape(-1, 4) for texture in (targets.position, targets.plane)
    )
    read = targets.filled or targets.indirect
    light = np.frombuffer(read.read(), "f4" if targets.filled else "f2").reshape(-1, 4).astype(np.float32)
    renderer.release()
    sums, expected = oracle.read_surface(fine, coarse, blend, position[:, :3], plane[:, :3].astype(float))
    if targets.filled:
        light[:, :3] /= np.abs(light[:, 3:])
    gap = sums[0, :, 3] < 2.0
    assert 0.1 < gap.mean() < 0.9
    np.testing.assert_allclose(light[:, :3], expected, rtol=1e-3, atol=1e-4)


def test_light_at_a_point_does_not_depend_on_the_camera(gl):
    """A point of a wall, in the middle pixel of frames from everywhere: its light may differ by the halves it is stored
    in, and by float32's rounding of the point over the distance in which colours change."""
    fine, coarse = surface_gaussians(room(), 1500), oracle.random_gaussians(30, 2, seed=1)
    target = np.array([0.31, -0.17, -1.0])
    eyes = np.random.default_rng(0).uniform([-0.8, -0.3, -0.2], [0.8, 0.8, 0.9], (40, 3))
    cameras = [look_at(eye, target, np.array([0.0, 1.0, 0.0]), 1.0, 0.01) for eye in eyes]
    cameras += [look_at(eyes[0], target, np.array([s, 1.0, 0.0]), 0.6 + s, 0.01) for s in np.linspace(0, 0.4, 20)]
    lights = []
    for camera in cameras:
        indirect, depth, _ = draw(gl, fine, coarse, room(), camera, size=(33, 33))
        assert np.allclose(seen_points(depth, camera)[16, 16], target, atol=1e-5)
        lights.append(indirect[16, 16])
    assert np.ptp(lights, axis=0).max() < 2 * 2**-11


def sphere(centre, radius=0.25, rings=24) -> Mesh:
    """Latitudes and longitudes, smooth normals."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    normal = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), -np.sin(polar) * np.sin(azimuth)], axis=-1)
    normal = normal.reshape(-1, 3).astype(np.float32)
    corner = (np.arange(rings)[:, None] * (2 * rings + 1) + np.arange(2 * rings)).ravel().astype(np.uint32)
    below = corner + np.uint32(2 * rings + 1)
    triangle = np.concatenate(
        [np.stack(t, axis=1) for t in ((corner, below, corner + 1), (corner + 1, below, below + 1))]
    )
    position = (np.asarray(centre) + radius * normal).astype(np.float32)
    return Mesh(position, normal, np.zeros((len(position), 0, 2), np.float32), triangle.astype(np.uint32), 0)


@pytest.mark.parametrize("height", [-0.75, 0.1])
def test_an_object_that_the_bake_never_saw_is_lit(gl, height):
    """On the floor or in mid-air."""
    fine = surface_gaussians(Scene(tuple(scenes.box()), (scenes.WHITE,)), 600)
    coarse = one(scale=(2, 2, 2), light=0.4)
    centre = 0, height, -0.3
    scene = Scene((*scenes.box(), sphere(centre)), (scenes.WHITE,))
    depth = draw(gl, fine, coarse, scene)[1]
    indirect = assert_equals_oracle(gl, fine, coarse, scene=scene)
    on_sphere = np.linalg.norm(seen_points(depth) - centre, axis=-1) < 0.26
    assert on_sphere.any()
    if height > 0:  # no wall's Gaussian reaches it
        assert np.allclose(indirect[on_sphere], 0.4, rtol=TOLERANCE)
    assert indirect.any(axis=-1).all()


@pytest.mark.parametrize("splat_scale", [1, 2])
def test_a_normal_map_bends_no_indirect_light(gl, splat_scale):
    """B belongs to the interpolated normal, of either side; the target for it is there only with normal maps."""
    texture = Texture(np.random.default_rng(0).integers(0, 256, (16, 16, 4), np.uint8), nearest=True)
    tangent = np.tile(np.float32([1, 0, 0, 1]), (4, 1))
    for camera in (ABOVE, look_at(np.array([0.0, -1, 0]), np.zeros(3), np.array([0.0, 0, -1]), np.pi / 2, 0.01)):
        found = []
        for slot in (None, TextureSlot(0)):
            material = replace(scenes.WHITE, double_sided=True, normal_texture=slot)
            scene = Scene((replace(scenes.floor(), tangent=tangent),), (material,), (texture,))
            fine = repeated(one(scale=(0.9, 0.9, 0.9)), 2)
            fine.rotation[1], fine.sh[1] = [UP[3], 0, 0, UP[3]], 9.0  # one for the side below
            renderer = DeferredRenderer(gl, scene, Bake(fine, BLEND, coarse=nothing()), *SIZE, splat_scale)
            renderer.render(camera)
            found.append([renderer.read(layer) for layer in ("indirect", "normal")])
            assert (renderer.gbuffer.interpolated is renderer.gbuffer.normal) == (slot is None)
            renderer.release()
        (light, normal), (mapped_light, mapped_normal) = found
        assert light.max() > 0.5
        np.testing.assert_array_equal(light, mapped_light)
        assert np.abs(normal - mapped_normal).max() > 0.5
