"""Path-traced B against closed forms, and full light against Mitsuba's own path tracer."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.irradiance import PASS_SAMPLES, Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Light, Material, Scene, Texture

UP = np.array([[0, 1, 0]], np.float32)
DOWN = -UP


def light(kind: str, **values) -> Light:
    defaults = {"color": np.array([3.0, 2.0, 1.0]), "position": np.array([0.0, 2.0, 0.0])}
    return Light(kind, **(defaults | {"direction": np.array([0.0, -1.0, 0.0])} | values))


def direct_at(lamp: Light, x: float = 0.0) -> np.ndarray:
    """Irradiance (3,) on an upward surface at (x, 0, 0)."""
    point = np.array([[x, 0, 0]], np.float32)
    return Tracer(scenes.lit_floor(lamp)).direct(point, UP, UP)[0] * np.pi


@pytest.mark.parametrize("albedo", [0.0, 0.5, 0.8])
def test_a_closed_emitting_box_holds_l_over_1_minus_r(albedo):
    tracer = Tracer(scenes.furnace(albedo, emission=1.5))
    surface = tracer.surface(scenes.inside_camera(), 24, 16)
    assert surface.valid.all()
    points = (a.reshape(-1, 3) for a in (surface.position, surface.normal, surface.geometric_normal))
    indirect = tracer.indirect(*points, samples=256, seed=1)
    # 384 points x 256 paths of sd < 1.0 per path: standard error below 0.004; corners make the tails heavy.
    assert indirect.mean() == pytest.approx(1.5 / (1 - albedo), rel=0.01)


def test_a_punctual_light_in_a_box_leaves_only_its_bounces_in_b():
    box = Scene(tuple(scenes.box()), (Material("wall", (0.5, 0.5, 0.5, 1.0)),), lights=(light("point"),))
    box = replace(box, lights=(light("point", position=np.zeros(3), color=np.ones(3)),))
    tracer = Tracer(box)
    surface = tracer.surface(scenes.inside_camera(), 48, 48)
    points = [a.reshape(-1, 3) for a in (surface.position, surface.normal, surface.geometric_normal)]
    # Energy: flux 4 pi arrives on area 24; with albedo 1/2 the mean bounced light equals the mean direct light.
    # Averages over the whole surface need even points, which a camera does not give: sample the walls.
    rng = np.random.default_rng(0)
    walls = [np.repeat(m.normal[:1], 512, axis=0) for m in box.meshes]
    normal = np.concatenate(walls)
    uv = rng.uniform(-1, 1, (len(normal), 3)).astype(np.float32)
    position = np.where(normal != 0, -normal, uv).astype(np.float32)
    direct = tracer.direct(position, normal, normal).mean()
    assert direct == pytest.approx(4 * np.pi / 24 / np.pi, rel=0.02)
    assert tracer.indirect(position, normal, normal, 128, seed=2).mean() == pytest.approx(direct, rel=0.02)
    assert np.isfinite(tracer.indirect(*points, PASS_SAMPLES, seed=3)).all()


def test_point_light_is_intensity_over_squared_distance():
    np.testing.assert_allclose(direct_at(light("point")), np.array([3, 2, 1]) / 4, rtol=1e-5)
    cosine = 2 / np.sqrt(5)
    np.testing.assert_allclose(direct_at(light("point"), x=1.0), np.array([3, 2, 1]) / 5 * cosine, rtol=1e-5)


def test_range_windows_the_light_and_ends_it():
    np.testing.assert_allclose(direct_at(light("point", range=4.0)), np.array([3, 2, 1]) / 4 * (1 - 1 / 16), rtol=1e-5)
    assert direct_at(light("point", range=2.0)).max() == 0


def test_directional_light_is_its_irradiance():
    slant = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    np.testing.assert_allclose(
        direct_at(light("directional", direction=slant)), np.array([3, 2, 1]) / np.sqrt(2), rtol=1e-5
    )


@pytest.mark.parametrize("degrees", [0, 5, 12, 20, 28, 31])
def test_spot_falls_off_by_the_squared_cosine_ramp(degrees):
    inner, outer = np.cos(np.radians([10, 30]))
    angle = np.radians(degrees)
    lamp = light("spot", color=np.ones(3), cos_inner=inner, cos_outer=outer)
    got = direct_at(lamp, x=2 * np.tan(angle))
    ramp = np.clip((np.cos(angle) - outer) / (inner - outer), 0, 1) ** 2
    expected = ramp * np.cos(angle) / (2 / np.cos(angle)) ** 2
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-7)


def test_single_bounce_off_a_plane():
    sun = light("directional", color=np.array([1.0, 2.0, 4.0]))
    scene = scenes.lit_floor(sun, half=2000.0)
    above = np.array([[0, 1, 0]], np.float32)
    # A floor without end under irradiance E has radiance albedo E / pi everywhere: so has B of what faces it.
    np.testing.assert_allclose(
        Tracer(scene).indirect(above, DOWN, DOWN, PASS_SAMPLES, 0)[0], 0.5 * np.array([1, 2, 4]) / np.pi, rtol=1e-4
    )
    np.testing.assert_array_equal(Tracer(scene).indirect(above, UP, UP, PASS_SAMPLES, 0), 0)


def test_the_back_of_a_single_sided_surface_is_invisible_black_and_stops_light():
    floor = Material("floor", (0.5, 0.5, 0.5, 1.0))
    lid = scenes.floor(half=5.0, height=1.0, material=1)  # faces up: its back looks at the floor
    sun = light("directional")
    for double_sided in (False, True):
        scene = Scene((scenes.floor(50.0), lid), (floor, replace(floor, double_sided=double_sided)), lights=(sun,))
        tracer = Tracer(scene)
        origin = np.array([[0, 0, 0]], np.float32)
        assert tracer.direct(origin, UP, UP).max() == 0
        below = look_at(np.array([0.0, 0.5, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), 0.5, 0.01)
        surface = tracer.surface(below, 3, 3)
        assert surface.valid.all() == surface.valid.any() == double_sided
        if double_sided:
            np.testing.assert_allclose(surface.normal[1, 1], [0, -1, 0], atol=1e-6)
            np.testing.assert_allclose(surface.depth[1, 1], 0.5, rtol=1e-5)


def test_light_passes_the_holes_of_an_alpha_mask():
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[:, 0, 3] = 0  # left half is a hole
    screen = Material("screen", base_color_texture=0, alpha_cutoff=0.5, double_sided=True)
    scene = Scene(
        (scenes.floor(50.0), scenes.floor(1.0, height=1.0, material=1)),
        (scenes.WHITE, screen),
        textures=(Texture(pixels, ("clamp", "clamp")),),
        lights=(light("directional", color=np.ones(3)),),
    )
    tracer = Tracer(scene)
    points = np.array([[-0.5, 0, 0], [0.5, 0, 0], [-2, 0, 0]], np.float32)
    up = np.repeat(UP, 3, axis=0)
    lit = tracer.direct(points, up, up)[:, 0] * np.pi
    np.testing.assert_allclose(lit, [1, 0, 1], atol=1e-6)
    above = look_at(np.array([0.0, 3.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.3, 0.01)
    depth = tracer.surface(above, 5, 1).depth[0]
    np.testing.assert_allclose(depth[[1, 3]], [3, 2], rtol=1e-5)


def test_a_double_sided_emitter_lights_both_sides():
    lamp = Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(1.0, 1.0, 1.0), double_sided=True)
    tracer = Tracer(Scene((scenes.floor(1000.0, material=0),), (lamp,)))
    points = np.array([[0, 1, 0], [0, -1, 0]], np.float32)
    facing = np.array([[0, -1, 0], [0, 1, 0]], np.float32)
    np.testing.assert_allclose(tracer.indirect(points, facing, facing, 64, 0), 1.0, rtol=0.02)


def test_textures_multiply_the_factor_in_linear_light():
    pixels = np.full((4, 4, 4), 188, np.uint8)
    material = Material("m", (0.5, 1.0, 0.25, 1.0), base_color_texture=0, metallic=0.5)
    tracer = Tracer(Scene((scenes.floor(),), (material,), textures=(Texture(pixels),)))
    albedo = tracer.surface(scenes.above_camera(), 8, 8).albedo[4, 4]
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(albedo, 0.5 * linear * np.array([0.5, 1.0, 0.25]), rtol=1e-5)


def test_the_same_seed_gives_the_same_bits_on_one_and_two_threads():
    import drjit as dr

    tracer = Tracer(scenes.furnace())
    surface = tracer.surface(scenes.inside_camera(), 16, 16)
    points = [a.reshape(-1, 3) for a in (surface.position, surface.normal, surface.geometric_normal)]
    first = tracer.indirect(*points, 64, seed=5)
    threads = dr.thread_count()
    dr.set_thread_count(1)
    try:
        np.testing.assert_array_equal(tracer.indirect(*points, 64, seed=5), first)
    finally:
        dr.set_thread_count(threads)
    assert (tracer.indirect(*points, 64, seed=6) != first).any()


def test_primary_plus_albedo_times_b_is_what_mitsuba_path_traces():
    import drjit as dr

    from gsgi.baker.mitsuba_scene import build, load_mitsuba

    mi = load_mitsuba()
    lamp = light("point", position=np.array([0.3, 0.5, 0.2]), color=np.array([1.0, 0.9, 0.8]))
    walls = [replace(mesh, material=i % 3) for i, mesh in enumerate(scenes.box())]
    block = [replace(m, position=m.position * np.float32(0.3)) for m in scenes.box(material=2, inward=False)]
    colours = [(0.7, 0.2, 0.2, 1.0), (0.2, 0.6, 0.3, 1.0), (0.7, 0.7, 0.7, 1.0)]
    materials = [Material(f"m{i}", colour) for i, colour in enumerate(colours)]
    glowing = replace(materials[1], emission=(0.2, 0.1, 0.05))
    scene = Scene((*walls, *block), (materials[0], glowing, materials[2]), lights=(lamp,))
    tracer = Tracer(scene)
    surface = tracer.surface(scenes.inside_camera(), 32, 32)
    points = [a.reshape(-1, 3) for a in (surface.position, surface.normal, surface.geometric_normal)]
    b = tracer.indirect(*points, 1024, seed=0).reshape(32, 32, 3)
    direct = tracer.direct(*points).reshape(32, 32, 3)
    ours = surface.emission + surface.albedo * (direct + b)

    intensity = {"type": "rgb", "value": lamp.color.tolist()}
    shapes = {f"shape{i}": shape for i, shape in enumerate(build(scene).shapes())}
    point = {"type": "point", "position": lamp.position.tolist(), "intensity": intensity}
    world = mi.load_dict({"type": "scene", "lamp": point, **shapes})
    eye = scenes.inside_camera().position
    direction = (points[0] - eye).repeat(1024, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ray = mi.RayDifferential3f(mi.Point3f(*map(float, eye)), mi.Vector3f(direction.T.astype(np.float32)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, len(direction))
    radiance, _, _ = mi.load_dict({"type": "path", "max_depth": 40}).sample(world, sampler, ray)
    theirs = np.stack([np.array(dr.block_sum(c, 1024)) / 1024 for c in radiance], axis=-1).reshape(32, 32, 3)
    # 1024 samples a pixel on either side: pixels agree within noise of about 2 %, the whole picture within 0.5 %.
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), theirs.mean(axis=(0, 1)), rtol=0.005)
    assert np.quantile(np.abs(ours - theirs) / theirs, 0.95) < 0.1


def test_direct_light_of_several_lights_is_their_sum_without_noise():
    lamps = [light("point"), light("directional", color=np.array([0.5, 0.25, 1.0]))]
    scene = replace(scenes.lit_floor(lamps[0]), lights=tuple(lamps))
    points = np.zeros((50, 3), np.float32)
    up = np.repeat(UP, 50, axis=0)
    direct = Tracer(scene).direct(points, up, up)
    np.testing.assert_allclose(direct, np.tile((np.array([3, 2, 1]) / 4 + lamps[1].color) / np.pi, (50, 1)), rtol=1e-5)


@pytest.mark.parametrize(("uv_scale", "textured"), [(1, False), (1, True), (3, True)])
def test_an_emissive_texture_lights_as_a_constant_does_however_it_is_mapped(uv_scale, textured):
    lid = scenes.floor(half=1.0, height=1.0, material=1)
    lid = replace(lid, triangle=lid.triangle[:, ::-1].copy(), normal=-lid.normal, uv=lid.uv * np.float32(uv_scale))
    twin = replace(lid, position=lid.position + np.float32([100, 0, 0]))  # the same texels once more
    lamp = Material("lamp", (0, 0, 0, 1), emission=(1, 1, 1), emission_texture=0 if textured else None)
    pixels = np.full((4, 4, 4), 255, np.uint8)
    tracer = Tracer(Scene((scenes.floor(0.5), lid, twin), (scenes.WHITE, lamp), textures=(Texture(pixels),)))
    b = tracer.indirect(np.zeros((64, 3), np.float32), *[np.repeat(UP, 64, axis=0)] * 2, 512, seed=0)
    # View factor of a square of half edge 1 seen from 1 below its middle (Howell, configuration B-3).
    r = 1 / np.sqrt(2)
    assert b.mean() == pytest.approx(4 / np.pi * r * np.arctan(r), rel=0.01)


def test_holes_of_an_emitter_give_no_light():
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[..., 3] = 0
    lamp = Material("lamp", emission=(1, 1, 1), base_color_texture=0, alpha_cutoff=0.5, double_sided=True)
    lid = scenes.floor(half=1.0, height=1.0, material=1)
    tracer = Tracer(Scene((scenes.floor(), lid), (scenes.WHITE, lamp), textures=(Texture(pixels),)))
    assert tracer.indirect(np.zeros((1, 3), np.float32), UP, UP, 256, seed=0).max() == 0


def test_a_black_emission_texture_is_no_light():
    lamp = Material("lamp", emission=(1, 1, 1), emission_texture=0)
    black = Scene((scenes.floor(),), (lamp,), textures=(Texture(np.zeros((2, 2, 4), np.uint8)),))
    tracer = Tracer(black)
    assert not tracer.emitters
    assert tracer.indirect(np.array([[0, 1, 0]], np.float32), DOWN, DOWN, 64, seed=0).max() == 0


def test_cameras_see_between_their_near_and_far_plane():
    scene = scenes.lit_floor(light("point"))
    camera = scenes.above_camera(3.0)
    for znear, zfar, seen in ((0.01, 2.9, False), (0.01, 3.1, True), (2.9, np.inf, True), (3.1, np.inf, False)):
        surface = Tracer(scene).surface(replace(camera, znear=znear, zfar=zfar), 4, 4)
        assert surface.valid.all() == surface.valid.any() == seen
