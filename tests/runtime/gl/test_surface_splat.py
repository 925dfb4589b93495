"""GL reading of Gaussians at surfaces against the numpy oracle."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import scenes
from surface_frames import BLEND, CAMERA, NAMES, SIZE, UP, draw, nothing, one, room, seen_points, surface_gaussians

import gsgi.runtime.gl.surface_level
from gsgi.runtime.camera import look_at
from gsgi.runtime.constants import GLSL_FOLDER
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend
from gsgi.runtime.gl.profile import Profile
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gl.surface_level import OUTLINE_CORNERS
from gsgi.runtime.gl.view import View
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
def test_outlines_cover_ellipsoids_of_every_orientation(gl, turn, scale):
    """Small ones, ones that reach through the eye's plane, and ones that hold the eye."""
    spin = 0, np.sin(turn / 2) * 0.6, np.sin(turn / 2) * 0.8, np.cos(turn / 2)
    for position in ((0, -0.9, -0.5), (-1, 0.2, 0.5), CAMERA.position, (0.3, -0.2, 1.4), (0.9, 0.9, -0.9)):
        assert_equals_oracle(gl, nothing(), one(position, scale, rotation=spin))


OUTLINE_SIZE = 320, 200
HIGH = look_at(np.array([0.0, 60, 0]), np.zeros(3), np.array([0.0, 0, -1]), 0.9, 0.01)


@pytest.mark.parametrize("margin", [0.0, 0.5])
@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4, 1.2, np.pi / 2, 2.5])
@pytest.mark.parametrize("scale", [(0.3, 0.02, 0.02), (0.3, 0.3, 1e-2), (2, 0.4, 0.1), (0.1, 9, 0.1), (30, 30, 0.05)])
def test_outlines_cover_each_pixel_once(gl, turn, scale, margin):
    """Fragments of one Gaussian against the rays that meet its ellipsoid beyond the near plane."""
    spin = 0, np.sin(turn / 2) * 0.6, np.sin(turn / 2) * 0.8, np.cos(turn / 2)
    for x, y, z in ((0, -0.9, -2.5), (-1, 0.2, -0.5), (0, 0, 0), (0.3, -0.2, 0.4), (0.1, 0.1, -30)):
        gaussian = one((x, 60 + z, -y), scale, rotation=spin)
        drawn, met = outline_fragments(gl, gaussian, margin), rays_that_meet(gaussian)
        assert met.sum() <= drawn <= met.size
        if z < -2 and max(scale) < 1:  # wholly in front of the eye: half a pixel more on each side, at most
            widened = [np.roll(met, (row - 1, column - 1), (0, 1)) for row, column in np.ndindex(3, 3)]
            assert drawn <= 1.35 * np.any(widened, axis=0).sum() + 20


def test_outlines_are_tight_around_the_eye(gl):
    """Flat Gaussians, as on a surface, of which many reach the near plane and the eye's."""
    rng, drawn, met = np.random.default_rng(0), 0, 0
    for _ in range(100):
        position, rotation = HIGH.position + rng.uniform(-1, 1, 3), rng.normal(size=4)
        gaussian = one(position, (*rng.uniform(0.1, 0.5, 2), 0.03), rotation=rotation / np.linalg.norm(rotation))
        drawn += outline_fragments(gl, gaussian, margin=0.0)
        met += rays_that_meet(gaussian).sum()
    assert met > 5 * np.prod(OUTLINE_SIZE)
    assert met <= drawn < 1.3 * met


def outline_fragments(gl, gaussian, margin) -> int:
    """How many fragments the outline of one Gaussian has in the view of HIGH, with nothing before it."""
    scene, size = Scene((scenes.floor(200.0),), (scenes.WHITE,)), OUTLINE_SIZE
    renderer = DeferredRenderer(gl, scene, Bake(gaussian, BLEND, coarse=nothing()), *size)
    splats, profile = renderer.splats._splats, Profile(gl)
    renderer.render(HIGH)
    view = View.of_camera(HIGH, size).moved(renderer.splats._origin)
    frame = {"view_from_world": view.pinhole.view_from_world, "near": HIGH.znear, "margin": margin}
    splats._programs.set(**frame)
    with profile.measure("outline"):
        splats._begin(splats.targets.fine_sums)
        splats._part.fine.draw(view, splats.targets)
    renderer.release()
    return profile.passes[0].fragments


def rays_that_meet(gaussian) -> np.ndarray:
    """(H, W) bool: pixels of HIGH whose ray comes within the radius of one Gaussian beyond the near plane."""
    camera, size = HIGH, OUTLINE_SIZE
    column, row = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    p = camera.pinhole(*size)
    ray = np.stack([(column - p.cx) / p.fx, (p.cy - row) / p.fy, -np.ones_like(row)], axis=-1)
    whiten = oracle.rotation_matrix(gaussian.rotation.astype(float))[0] / gaussian.scale[0].astype(float)
    ray = ray @ camera.world_from_view[:3, :3].T @ whiten
    eye = (camera.position - gaussian.position[0]) @ whiten
    depth = np.maximum(camera.znear, -(ray @ eye) / (ray**2).sum(axis=-1))
    return ((eye + depth[..., None] * ray) ** 2).sum(axis=-1) <= BLEND.radius**2


def test_python_and_glsl_agree_on_the_corners_of_an_outline():
    text = (GLSL_FOLDER / "lib" / "ellipsoid.glsl").read_text(encoding="utf-8")
    assert f"#define OUTLINE_CORNERS  {OUTLINE_CORNERS} " in text


def test_the_box_around_the_eye_is_read_too(gl):
    """Gaussians all around the camera, many across its plane."""
    fine = oracle.random_gaussians(300, 0, seed=3)
    rng = np.random.default_rng(4)
    around = (CAMERA.position + rng.normal(size=(300, 3)) * 0.5).astype(np.float32)
    assert_equals_oracle(gl, nothing(), replace(fine, position=around))


def test_culling_never_shows(gl, monkeypatch):
    gaussians = oracle.random_gaussians(2000, 0, seed=3)
    gaussians = replace(gaussians, position=gaussians.position * np.float32(1.6))
    seen = draw(gl, gaussians)[0]
    everything = np.arange(2000, dtype=np.uint32)
    monkeypatch.setattr(gsgi.runtime.gl.surface_level, "in_view", lambda *_: everything)
    assert np.array_equal(seen, draw(gl, gaussians)[0])


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


def test_a_bake_without_coarse_gaussians_has_neither_their_target_nor_their_passes(gl):
    for coarse, made in ((nothing(), False), (one(), True)):
        renderer = DeferredRenderer(gl, FLOOR, Bake(one(), BLEND, coarse=coarse), 8, 8)
        renderer.render(CAMERA)
        splats = renderer.splats._splats
        parts = splats._part.coarse, splats._gap, splats.targets.coarse, splats.targets.coarse_sums
        assert [part is not None for part in parts] == [made] * 4
        renderer.release()


@pytest.mark.parametrize("splat_scale", [1, 2, 3, 4])
def test_the_coarse_level_is_drawn_only_into_gaps(gl, splat_scale):
    """Its sums are the oracle's where the fine level weighs less than the floor, and nothing elsewhere."""
    scene, coarse = room(), oracle.random_gaussians(30, 2, seed=1)
    bake = Bake(surface_gaussians(scene, 150), SurfaceBlend(floor=2.0), coarse=coarse)
    renderer = DeferredRenderer(gl, scene, bake, *SIZE, splat_scale)
    renderer.render(CAMERA)
    targets = renderer.splats._splats.targets
    textures = targets.position, targets.plane, targets.fine, targets.coarse
    position, plane, fine, drawn = (np.frombuffer(texture.read(), np.float32).reshape(-1, 4) for texture in textures)
    renderer.release()
    expected = oracle.read_surface(nothing(), coarse, BLEND, position[:, :3], plane[:, :3].astype(float))[0][1]
    gap = fine[:, 3] < 2.0
    assert 0.1 < gap.mean() < 0.9
    np.testing.assert_allclose(drawn[gap], expected[gap], rtol=1e-3, atol=1e-4)
    assert not drawn[~gap].any()


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
