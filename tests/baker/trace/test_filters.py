"""Light through blended and transmissive surfaces, against closed forms and Mitsuba's `mask` and `thindielectric`."""

from dataclasses import replace

import mitsuba_twin
import numpy as np
import pytest
import scenes

from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Environment, Filter, Light, Material, Scene, Texture, TextureSlot

ORIGIN, UP = np.zeros((1, 3), np.float32), np.array([[0, 1, 0]], np.float32)
WHITE_SKY = Environment(np.ones((1, 1, 3), np.float32))
SUN = Light("directional", np.full(3, np.pi), np.zeros(3), np.array([0.0, -1.0, 0.0]))
BLEND, GLASS = Filter(blends=True), Filter(transmission=1.0)
WIDE = 5000.0  # m; sheets of this size hide the sky


def pane(passes: Filter, color, **fields) -> Material:
    return Material("pane", color, filter=passes, stand_in=True, double_sided=True, **fields)


def under(*panes: Material, **light) -> Scene:
    """A white floor under sheets, from 1 m upwards."""
    floor = Material("floor", double_sided=True)
    sheets = [scenes.floor(WIDE, 1 + 0.01 * k, 1 + k) for k in range(len(panes))]
    return Scene((scenes.floor(50.0), *sheets), (floor, *panes), **light)


def b_and_direct(scene: Scene, samples: int = 1024) -> np.ndarray:
    """B (3,) and the direct light (3,) at the origin."""
    tracer = Tracer(scene)
    light = tracer.indirect(ORIGIN, UP, UP, Sampling(samples), seed=1)
    assert not light.invalid
    return np.concatenate([light.mean, tracer.direct(ORIGIN, UP, UP)])


@pytest.mark.parametrize(
    ("passes", "color", "transmitted"),
    [
        (BLEND, (0.0, 0.0, 0.0, 0.25), (0.75, 0.75, 0.75)),
        (BLEND, (1.0, 0.0, 0.0, 0.0), (1, 1, 1)),
        (BLEND, (1.0, 0.5, 0.2, 1.0), (0, 0, 0)),
        (Filter(blends=True, stained=True), (1.0, 0.5, 0.0, 0.25), (0.75, 0.375, 0)),
        (GLASS, (0.8, 0.5, 0.2, 1.0), (0.8, 0.5, 0.2)),
        (Filter(transmission=0.5), (0.8, 0.5, 0.2, 0.3), (0.4, 0.25, 0.1)),
        (Filter(blends=True, transmission=0.5), (0.8, 0.4, 0.0, 0.5), (0.7, 0.6, 0.5)),
    ],
)
def test_sunlight_through_a_sheet_is_indirect_and_has_its_tint(passes, color, transmitted):
    """The sheet is black to what comes from below: it is one-sided, and the floor sees its back."""
    below = replace(pane(passes, color), double_sided=False)
    b, direct = b_and_direct(under(below, lights=(SUN,)), 64)
    np.testing.assert_allclose(b, transmitted, atol=1e-5)
    assert not direct.any()


def test_where_alpha_is_too_low_to_be_drawn_sunlight_is_direct():
    clear = pane(BLEND, (1.0, 1.0, 1.0, 0.003), alpha_cutoff=1 / 255)
    b, direct = b_and_direct(under(clear, lights=(SUN,)), 64)
    np.testing.assert_array_equal(b, 0)
    np.testing.assert_allclose(direct, 1, rtol=1e-5)


@pytest.mark.parametrize(
    ("passes", "color"),
    [
        (replace(BLEND, clear=1 / 3), (1.0, 0.5, 0.2, 0.3)),
        (replace(GLASS, clear=np.inf), (0.9, 0.8, 0.7, 1.0)),
        (Filter(blends=True, transmission=0.5, clear=0.6), (0.8, 0.9, 1.0, 0.5)),
    ],
)
def test_sunlight_through_a_clear_sheet_is_direct_and_what_it_lights_is_dimmed(passes, color):
    """A white wall bounces light to the floor: as much of it as the sheet lets through."""
    sheet = replace(pane(passes, color), double_sided=False)
    scene = under(sheet, lights=(replace(SUN, direction=np.array([0.6, -0.8, 0.0])),))
    wall = scenes.quad([(0.5, 0, -50), (0.5, 0.9, -50), (0.5, 0.9, 50), (0.5, 0, 50)], 0)
    with_wall = replace(scene, meshes=(*scene.meshes, wall))
    bare = replace(with_wall, meshes=(scene.meshes[0], wall))
    b, direct = b_and_direct(with_wall, 4096)
    np.testing.assert_allclose(direct, 0.8, rtol=1e-5)
    assert not b_and_direct(scene, 64)[0].any()
    without, _ = b_and_direct(bare, 4096)
    assert without.min() > 0.05
    transmitted, _ = b_and_direct(under(replace(sheet, filter=replace(passes, clear=0.0)), lights=(SUN,)), 64)
    np.testing.assert_allclose(b / without, transmitted, rtol=0.05)
    dimmed = Tracer(with_wall).direct(ORIGIN, UP, UP, dims=True)[0]
    np.testing.assert_allclose(dimmed, 0.8 * transmitted, rtol=1e-4)


def test_the_shadow_of_one_sheet_is_not_lit_through_another():
    clear, curtain = pane(replace(BLEND, clear=0.5), (1, 1, 1, 0.25)), pane(BLEND, (1, 1, 1, 0.25))
    for panes in ((clear, curtain), (curtain, clear)):
        b, direct = b_and_direct(under(*(replace(each, double_sided=False) for each in panes), lights=(SUN,)), 64)
        np.testing.assert_allclose(b, 0.75**2, rtol=1e-5)
        assert not direct.any()


def test_clear_and_dim_parts_of_a_texture_differ():
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, :, 3] = 51, 153
    glazed = pane(replace(BLEND, clear=1 / 3), (1, 1, 1, 1.0), base_color_texture=TextureSlot(0))
    textures = (Texture(pixels, nearest=True),)
    tracer = Tracer(under(replace(glazed, double_sided=False), lights=(SUN,), textures=textures))
    for x, direct, b in ((-2, 1.0, 0.0), (2, 0.0, 0.4)):
        point = np.float32([[x, 0, 0]])
        np.testing.assert_allclose(tracer.direct(point, UP, UP), direct, rtol=1e-5)
        np.testing.assert_allclose(tracer.indirect(point, UP, UP, Sampling(64), seed=0).mean, b, atol=1e-5)


def test_the_sky_through_tinted_glass_has_its_tint():
    b, _ = b_and_direct(under(pane(GLASS, (0.8, 0.5, 0.2, 1.0)), environment=WHITE_SKY), 4096)
    np.testing.assert_allclose(b, [0.8, 0.5, 0.2], rtol=0.015)


@pytest.mark.parametrize("passes", [BLEND, Filter(transmission=0.7), Filter(blends=True, transmission=0.5)])
def test_white_sheets_change_nothing_in_a_furnace(passes):
    room = scenes.furnace()
    sheets = tuple(scenes.floor(0.9, height, 1) for height in (-0.4, 0.0, 0.3))
    tracer = Tracer(
        replace(room, meshes=room.meshes + sheets, materials=(*room.materials, pane(passes, (1, 1, 1, 0.5))))
    )
    surface = tracer.surface(scenes.inside_camera(), 24, 24)
    b = tracer.indirect(*surface.points(), Sampling(256), seed=0)
    assert abs(b.mean.mean() - 2) < 0.005


def test_a_hundred_sheets_let_through_what_they_must_and_more_end():
    thin = pane(BLEND, (1.0, 1.0, 1.0, 0.01))
    b, _ = b_and_direct(under(*[thin] * 100, environment=WHITE_SKY), 1024)
    np.testing.assert_allclose(b, 1, rtol=0.01)
    black = replace(thin, base_color=(0.0, 0.0, 0.0, 0.01), double_sided=False)
    b, _ = b_and_direct(under(*[black] * 100, lights=(SUN,)), 32)
    np.testing.assert_allclose(b, 0.99**100, rtol=1e-4)
    b, _ = b_and_direct(under(*[black] * 300, lights=(SUN,), environment=WHITE_SKY), 32)
    assert np.isfinite(b).all()


def test_light_passes_a_large_tilted_sheet_once_however_it_grazes():
    """A hit of such a sheet is off its plane by much more than rays that meet it head-on skip."""
    rng = np.random.default_rng(0)
    normal = np.array([0.48, 0.6, 0.64])
    across = np.array([0.8, 0.0, -0.6])
    along = np.cross(normal, across)
    corners = [across * x + along * y + normal for x, y in ((-WIDE, -WIDE), (WIDE, -WIDE), (WIDE, WIDE), (-WIDE, WIDE))]
    tracer = Tracer(Scene((scenes.quad(corners, 0),), (pane(BLEND, (0.0, 0.0, 0.0, 0.5)),)))
    met = normal + rng.uniform(-1, 1, (4000, 1)) * along + rng.uniform(-1, 1, (4000, 1)) * across
    slope = 10 ** rng.uniform(-3, 0, (4000, 1))
    towards = slope * normal + rng.normal(size=(4000, 1)) * across + rng.normal(size=(4000, 1)) * along
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    factor = tracer.launched(_passed, met - 2 * towards, towards)["factor"]
    np.testing.assert_allclose(factor, 0.5, rtol=1e-5)


def _passed(tracer, origin, direction):
    from gsgi.baker.trace.mitsuba_scene import load_mitsuba
    from gsgi.baker.trace.rays import transmitted

    mi = load_mitsuba()
    o, d = mi.Point3f(origin.T), mi.Vector3f(direction.T)
    active = mi.Bool((direction != 0).any(axis=1))
    factor, *_ = transmitted(tracer, o, d, mi.Float(4.0), active)
    return {"factor": np.array(factor).T[:, 0]}


def test_alpha_comes_from_the_texture():
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, 0, 3] = 0
    holes = Texture(pixels, nearest=True)
    half = pane(BLEND, (0.0, 0.0, 0.0, 1.0), base_color_texture=TextureSlot(0), alpha_cutoff=1 / 255)
    scene = under(replace(half, double_sided=False), lights=(SUN,), textures=(holes,))
    tracer = Tracer(scene)
    left, right = np.float32([[-2, 0, 0]]), np.float32([[2, 0, 0]])
    for point, expected in ((left, 1.0), (right, 0.0)):
        np.testing.assert_allclose(tracer.direct(point, UP, UP), expected, rtol=1e-5)
        np.testing.assert_array_equal(tracer.indirect(point, UP, UP, Sampling(64), seed=0).mean, 0)


@pytest.mark.parametrize("extra", [(), (BLEND,)])
def test_a_glowing_film_emits_by_its_opacity_and_through_others(extra):
    film = pane(BLEND, (0.0, 0.0, 0.0, 0.25), emission=(4.0, 2.0, 1.0))
    others = [pane(passes, (0.0, 0.0, 0.0, 0.5)) for passes in extra]
    b, _ = b_and_direct(under(*others, film), 4096)
    np.testing.assert_allclose(b, np.array([1.0, 0.5, 0.25]) * 0.5 ** len(extra), rtol=0.03)


def test_cameras_stop_at_what_is_at_least_half_opaque():
    for alpha, albedo in ((0.5, 0.25), (0.49, 1.0)):
        scene = under(pane(BLEND, (0.25, 0.25, 0.25, alpha)), environment=WHITE_SKY)
        assert Tracer(scene).surface(scenes.above_camera(), 4, 4).albedo[2, 2, 0] == np.float32(albedo)


def test_a_scene_without_filters_has_none():
    tracer = Tracer(scenes.furnace())
    assert tracer.filtering is None
    assert tracer.shading.filters is None


def glass_room() -> Scene:
    """A closed room under a lamp; a blended and a transmissive sheet across its middle leave a gap at the walls."""
    low, high = -0.9, 0.9
    left = scenes.quad([(low, 0, high), (0, 0, high), (0, 0, low), (low, 0, low)], 3)
    right = scenes.quad([(0, 0.1, high), (high, 0.1, high), (high, 0.1, low), (0, 0.1, low)], 4)
    lamp = scenes.quad([(-0.6, 0.95, -0.6), (0.6, 0.95, -0.6), (0.6, 0.95, 0.6), (-0.6, 0.95, 0.6)], 2)
    walls = [replace(mesh, material=i % 2) for i, mesh in enumerate(scenes.box())]
    materials = (
        Material("grey", (0.6, 0.6, 0.6, 1.0)),
        Material("warm", (0.7, 0.5, 0.3, 1.0)),
        Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(6.0, 5.0, 4.0)),
        pane(BLEND, (0.8, 0.2, 0.1, 0.5)),
        pane(Filter(transmission=0.7), (0.2, 0.8, 0.4, 1.0)),
    )
    return Scene((*walls, lamp, left, right), materials)


def test_a_blended_and_a_transmissive_sheet_light_a_room_as_in_mitsuba():
    scene, samples = glass_room(), 1024
    eye = np.array([0.3, -0.2, 0.85])  # under the sheets, and looks down: it sees nothing through them
    camera = look_at(eye, np.array([-0.2, -1.0, -0.3]), np.array([0.0, 1.0, 0.0]), 0.8, 0.01)
    tracer = Tracer(scene)
    surface = tracer.surface(camera, 24, 24)
    assert surface.position[surface.valid][:, 1].max() < -0.05
    b = tracer.indirect(*surface.points(), Sampling(samples), seed=0)
    ours = surface.albedo[surface.valid] * b.mean
    theirs = mitsuba_twin.radiance(scene, surface.points()[0], camera.position, samples)
    np.testing.assert_allclose(ours.mean(axis=0), theirs.mean(axis=0), rtol=0.01)
    assert np.quantile(np.abs(ours - theirs) / (theirs + 0.05 * theirs.mean()), 0.9) < 0.2


def test_the_same_bits_on_one_and_two_threads():
    import drjit as dr

    tracer = Tracer(replace(glass_room(), lights=(SUN,), environment=WHITE_SKY))
    points = tracer.surface(scenes.inside_camera(), 16, 16).points()
    first = tracer.indirect(*points, Sampling(64), seed=5).mean
    threads = dr.thread_count()
    dr.set_thread_count(1)
    try:
        np.testing.assert_array_equal(tracer.indirect(*points, Sampling(64), seed=5).mean, first)
    finally:
        dr.set_thread_count(threads)
