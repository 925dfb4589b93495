"""Path-traced B against closed forms, and full light against Mitsuba's own path tracer."""

from dataclasses import replace

import mitsuba_twin
import numpy as np
import pytest
import scenes
from repository import SCENES

from gsgi.baker.trace import tracer as tracing
from gsgi.baker.trace.tracer import LAUNCH_POINTS, PASS_SAMPLES, Sampling, Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.light_groups import lit_by
from gsgi.runtime.scene import Environment, Light, Material, Scene, Texture, TextureSlot

UP = np.array([[0, 1, 0]], np.float32)
DOWN = -UP
WHITE_SKY = Environment(np.ones((1, 1, 3), np.float32))


def light(kind: str, **values) -> Light:
    defaults = {"color": np.array([3.0, 2.0, 1.0]), "position": np.array([0.0, 2.0, 0.0])}
    return Light(kind, **(defaults | {"direction": np.array([0.0, -1.0, 0.0])} | values))


def direct_at(lamp: Light, x: float = 0.0) -> np.ndarray:
    """Irradiance (3,) on an upward surface at (x, 0, 0)."""
    point = np.array([[x, 0, 0]], np.float32)
    return Tracer(scenes.lit_floor(lamp)).direct(point, UP, UP)[0] * np.pi


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
    assert tracer.indirect(position, normal, normal, Sampling(128), seed=2).mean.mean() == pytest.approx(
        direct, rel=0.02
    )
    assert np.isfinite(tracer.indirect(*points, Sampling(PASS_SAMPLES), seed=3).mean).all()


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
        Tracer(scene).indirect(above, DOWN, DOWN, Sampling(PASS_SAMPLES), 0).mean[0],
        0.5 * np.array([1, 2, 4]) / np.pi,
        rtol=1e-4,
    )
    np.testing.assert_array_equal(Tracer(scene).indirect(above, UP, UP, Sampling(PASS_SAMPLES), 0).mean, 0)


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
    screen = Material("screen", base_color_texture=TextureSlot(0), alpha_cutoff=0.5, double_sided=True)
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
    np.testing.assert_allclose(tracer.indirect(points, facing, facing, Sampling(64), 0).mean, 1.0, rtol=0.02)


def test_textures_multiply_the_factor_in_linear_light():
    pixels = np.full((4, 4, 4), 188, np.uint8)
    material = Material("m", (0.5, 1.0, 0.25, 1.0), base_color_texture=TextureSlot(0), metallic=0.5)
    tracer = Tracer(Scene((scenes.floor(),), (material,), textures=(Texture(pixels),), metals="black"))
    albedo = tracer.surface(scenes.above_camera(), 8, 8).albedo[4, 4]
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(albedo, 0.5 * linear * np.array([0.5, 1.0, 0.25]), rtol=1e-5)


def test_the_same_seed_gives_the_same_bits_on_one_and_two_threads():
    import drjit as dr

    tracer = Tracer(scenes.furnace())
    surface = tracer.surface(scenes.inside_camera(), 16, 16)
    points = [a.reshape(-1, 3) for a in (surface.position, surface.normal, surface.geometric_normal)]
    first = tracer.indirect(*points, Sampling(64), seed=5).mean
    threads = dr.thread_count()
    dr.set_thread_count(1)
    try:
        np.testing.assert_array_equal(tracer.indirect(*points, Sampling(64), seed=5).mean, first)
    finally:
        dr.set_thread_count(threads)
    assert (tracer.indirect(*points, Sampling(64), seed=6).mean != first).any()


def textured_room() -> Scene:
    """A closed room with patterned, glowing and grey walls, a two-sided screen and a lamp.

    Without alpha masks, which are solid to Mitsuba's shadow rays, and glowing evenly, for Mitsuba draws points of a
    textured emitter in its texture.
    """
    rng = np.random.default_rng(4)
    pattern = rng.integers(0, 255, (5, 7, 4), np.uint8)
    other = rng.integers(0, 255, (5, 7, 4), np.uint8)
    walls = [replace(mesh, material=i % 3, uv=mesh.uv * np.float32(1.7) - 0.4) for i, mesh in enumerate(scenes.box())]
    screen = replace(scenes.floor(0.5, height=0.2, material=3), uv=walls[0].uv)
    paper = Material("paper", (0.8, 0.7, 0.9, 1.0), base_color_texture=TextureSlot(0))
    materials = (
        paper,
        Material("glow", (0.4, 0.6, 0.3, 1.0), base_color_texture=TextureSlot(1), emission=(0.5, 0.3, 0.2)),
        Material("grey", (0.6, 0.6, 0.6, 1.0)),
        replace(paper, double_sided=True),
    )
    textures = Texture(pattern, ("mirror", "mirror")), Texture(other, ("clamp", "clamp"))
    lamp = light("point", position=np.array([0.3, 0.5, 0.2]), color=np.array([1.0, 0.9, 0.8]))
    return Scene((*walls, screen), materials, textures, (lamp,), cameras={"inside": scenes.inside_camera()})


def cornell() -> Scene:
    """The Cornell box under its area light."""
    return read_gltf(SCENES / "cornell_emissive.glb")


@pytest.mark.parametrize("scene", [textured_room, cornell])
def test_primary_plus_albedo_times_b_is_what_mitsuba_path_traces(scene):
    scene, samples = scene(), 1024
    camera = next(iter(scene.cameras.values()))
    tracer = Tracer(scene)
    surface = tracer.surface(camera, 32, 32)
    b = tracer.indirect(*surface.points(), Sampling(samples), seed=0)
    ours = (surface.emission + surface.albedo * surface.image(b.mean + tracer.direct(*surface.points())))[surface.valid]
    theirs = mitsuba_twin.radiance(scene, surface.points()[0], camera.position, samples)
    # 1024 samples a pixel on either side: pixels agree within noise of a few %, the whole picture within 0.5 %.
    np.testing.assert_allclose(ours.mean(axis=0), theirs.mean(axis=0), rtol=0.005)
    assert np.quantile(np.abs(ours - theirs) / (theirs + 0.05 * theirs.mean()), 0.95) < 0.1


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
    lamp = Material("lamp", (0, 0, 0, 1), emission=(1, 1, 1), emission_texture=TextureSlot(0) if textured else None)
    pixels = np.full((4, 4, 4), 255, np.uint8)
    tracer = Tracer(Scene((scenes.floor(0.5), lid, twin), (scenes.WHITE, lamp), textures=(Texture(pixels),)))
    b = tracer.indirect(np.zeros((64, 3), np.float32), *[np.repeat(UP, 64, axis=0)] * 2, Sampling(512), seed=0).mean
    # View factor of a square of half edge 1 seen from 1 below its middle (Howell, configuration B-3).
    r = 1 / np.sqrt(2)
    assert b.mean() == pytest.approx(4 / np.pi * r * np.arctan(r), rel=0.01)


def test_holes_of_an_emitter_give_no_light():
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[..., 3] = 0
    lamp = Material("lamp", emission=(1, 1, 1), base_color_texture=TextureSlot(0), alpha_cutoff=0.5, double_sided=True)
    lid = scenes.floor(half=1.0, height=1.0, material=1)
    tracer = Tracer(Scene((scenes.floor(), lid), (scenes.WHITE, lamp), textures=(Texture(pixels),)))
    assert tracer.indirect(np.zeros((1, 3), np.float32), UP, UP, Sampling(256), seed=0).mean.max() == 0


def test_a_black_emission_texture_is_no_light():
    lamp = Material("lamp", emission=(1, 1, 1), emission_texture=TextureSlot(0))
    black = Scene((scenes.floor(),), (lamp,), textures=(Texture(np.zeros((2, 2, 4), np.uint8)),))
    tracer = Tracer(black)
    assert not tracer.emitters.count
    assert tracer.indirect(np.array([[0, 1, 0]], np.float32), DOWN, DOWN, Sampling(64), seed=0).mean.max() == 0


def test_cameras_see_between_their_near_and_far_plane():
    scene = scenes.lit_floor(light("point"))
    camera = scenes.above_camera(3.0)
    for znear, zfar, seen in ((0.01, 2.9, False), (0.01, 3.1, True), (2.9, np.inf, True), (3.1, np.inf, False)):
        surface = Tracer(scene).surface(replace(camera, znear=znear, zfar=zfar), 4, 4)
        assert surface.valid.all() == surface.valid.any() == seen


def even_points(scene: Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Position and normal (count, 3) of points spread over the walls of `scenes.box()`."""
    rng = np.random.default_rng(0)
    normal = np.concatenate([np.repeat(m.normal[:1], count // 6, axis=0) for m in scene.meshes])
    spread = rng.uniform(-1, 1, normal.shape).astype(np.float32)
    return np.where(normal != 0, -normal, spread).astype(np.float32), normal


@pytest.mark.parametrize("bounces", [0, 1, 3])
def test_paths_end_after_as_many_surfaces_as_are_asked_for(bounces):
    scene = scenes.furnace(albedo=0.5, emission=1.0)
    position, normal = even_points(scene, 600)
    b = Tracer(scene).indirect(position, normal, normal, Sampling(64, bounces), seed=0).mean
    assert b.mean() == pytest.approx(sum(0.5**k for k in range(bounces + 1)), rel=0.01)


def test_a_path_takes_the_same_turns_however_far_it_is_followed():
    scene = Scene(tuple(scenes.box()), (scenes.WHITE,), lights=(light("point", position=np.zeros(3)),))
    position, normal = even_points(scene, 600)
    tracer = Tracer(scene)
    means = [tracer.indirect(position, normal, normal, Sampling(32, k), seed=0).mean for k in (1, 2, 8)]
    # Each further bounce only adds light: noise would make some points darker.
    assert (means[0] <= means[1]).all()
    assert (means[1] <= means[2] * (1 + 1e-6)).all()
    assert means[0].max() > 0


def test_one_trace_tells_the_light_of_every_number_of_bounces():
    scene = scenes.furnace(albedo=0.5, emission=0.1)
    lit = replace(scene, lights=(light("point", position=np.zeros(3)),), environment=WHITE_SKY)
    scene = replace(lit, meshes=lit.meshes[:-1])  # an open side
    position, normal = even_points(scene, 600)
    tracer, sampling = Tracer(scene), Sampling(64)
    found = tracer.by_bounces(position, normal, normal, sampling, 0, 4)
    whole = tracer.indirect(position, normal, normal, sampling, 0)
    for name, values in vars(whole).items():
        assert np.array_equal(values, getattr(found.light, name)), name
    assert found.within.shape == (5, *position.shape)
    for k, within in enumerate(found.within):
        alone = tracer.indirect(position, normal, normal, Sampling(64, k), 0).mean
        np.testing.assert_allclose(within, alone, rtol=1e-4, atol=1e-6)
    assert (found.within[4] < whole.mean).any()


def test_passes_that_share_a_launch_keep_their_bits():
    scene = scenes.furnace(albedo=0.5, emission=1.0)
    position, normal = even_points(scene, 600)
    points, tracer = (position, normal, normal), Tracer(scene)
    together = tracer.indirect(*points, Sampling(5 * PASS_SAMPLES, 2), seed=0)
    # What is to end before each pass begins has launches of its own; no point ends this early.
    apart = tracer.indirect(*points, Sampling(5 * PASS_SAMPLES, 2, error=1e-12), seed=0)
    for name, values in vars(apart).items():
        np.testing.assert_array_equal(getattr(together, name), values, name)


@pytest.mark.parametrize("count", [0, 1, 31, 33, 4096, LAUNCH_POINTS - 1, LAUNCH_POINTS])
def test_points_are_spread_evenly_over_the_lanes_of_a_launch(count):
    lanes = tracing._lanes(count, LAUNCH_POINTS)
    assert len(set(lanes.tolist())) == count
    assert (np.diff(lanes) > 0).all()
    shares = np.histogram(lanes, 4, (0, LAUNCH_POINTS))[0]
    assert np.ptp(shares) <= tracing.RUN
    if count == LAUNCH_POINTS:
        assert (lanes == np.arange(count)).all()


def test_the_standard_error_is_the_spread_of_the_mean():
    scene = scenes.furnace(albedo=0.5)
    position, normal = even_points(scene, 12)
    tracer = Tracer(scene)
    runs = [tracer.indirect(position, normal, normal, Sampling(64), seed) for seed in range(200)]
    spread = np.std([run.mean.mean(axis=1) for run in runs], axis=0)
    claimed = np.mean([run.error for run in runs], axis=0)
    # The lattice of first directions makes the mean steadier than independent paths would be: never much worse.
    assert (spread < 1.15 * claimed).all()
    assert (spread > 0.2 * claimed).all()


def test_points_stop_at_their_standard_error_and_dark_ones_later_than_their_own_samples_say():
    lid = scenes.floor(half=1.0, height=0.5, material=1)
    lid = replace(lid, triangle=lid.triangle[:, ::-1].copy(), normal=-lid.normal)
    lamp = Material("lamp", (0, 0, 0, 1), emission=(2, 2, 2))
    tracer = Tracer(Scene((scenes.floor(2.0), lid), (scenes.WHITE, lamp)))
    position = np.array([[0, 0, 0], [1.5, 0, 0], [0, -1, 0]], np.float32)
    up = np.repeat(UP, 3, axis=0)
    light = tracer.indirect(position, up, up, Sampling(2048, error=0.01, scale=0.01), seed=0)
    assert light.samples.min() >= PASS_SAMPLES
    assert (light.samples < 2048).any()
    assert (light.error <= 0.01 * (light.mean.mean(axis=1) + 0.01))[light.samples < 2048].all()
    assert light.samples[2] > PASS_SAMPLES  # black below the floor, as far as its own paths can tell
    capped = tracer.indirect(position, up, up, Sampling(64, error=1e-9), seed=0)
    np.testing.assert_array_equal(capped.samples, 64)


def test_stopping_early_leaves_dark_points_as_bright_as_they_are():
    scene = cornell()
    tracer = Tracer(scene)
    points = tracer.surface(next(iter(scene.cameras.values())), 48, 48).points()
    truth = tracer.indirect(*points, Sampling(2048, 8), seed=99).mean.mean(axis=1)
    dark = truth < np.median(truth)
    early = Sampling(1024, 8, error=0.1, scale=truth.mean())
    lights = [tracer.indirect(*points, early, seed) for seed in range(6)]
    assert np.mean([light.samples.mean() for light in lights]) < 64
    # Points that stop because they missed the light so far would take 1.6 % here with a prior of 16 paths.
    brightness = np.mean([light.mean.mean(axis=1)[dark].mean() for light in lights])
    assert brightness == pytest.approx(truth[dark].mean(), rel=0.008)


def test_paths_that_give_no_number_are_counted_and_left_out():
    lamp = Material("lamp", (0.5, 0.5, 0.5, 1.0), emission=(1e38, 1e38, 1e38), double_sided=True)
    tracer = Tracer(
        Scene(tuple(replace(m, material=0) for m in scenes.box()), (replace(lamp, base_color=(1, 1, 1, 1)),))
    )
    position, normal = even_points(Scene(tuple(scenes.box()), (lamp,)), 60)
    light = tracer.indirect(position, normal, normal, Sampling(64), seed=0)
    assert light.invalid > 0
    assert np.isfinite(light.mean).all()


@pytest.mark.parametrize("error", [0.0, 0.05])
@pytest.mark.parametrize("emission", [1.0, 0.0])  # without noise: a standard error of 0
def test_progress_adds_up_to_the_points_whether_they_stop_early_or_not(error, emission):
    scene = scenes.furnace(emission=emission)
    position, normal = even_points(scene, 60)
    done = []
    Tracer(scene).indirect(position, normal, normal, Sampling(320, error=error), 0, done.append)
    assert sum(done) == pytest.approx(60)


def test_an_emissive_material_on_a_triangle_without_area_is_no_light():
    lamp = Material("lamp", emission=(1, 1, 1))
    line = replace(scenes.floor(material=1), position=np.float32([[0, 1, 0]] * 4))
    b = Tracer(Scene((scenes.floor(), line), (scenes.WHITE, lamp))).indirect(np.zeros((1, 3)), UP, UP, Sampling(32), 0)
    assert b.mean.max() == 0


def turned(scene: Scene, offset: np.ndarray) -> tuple[Scene, np.ndarray]:
    """The scene turned to lie along no axis and moved, and the rotation (3, 3)."""
    rotation, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    rotation *= np.linalg.det(rotation)
    meshes = (
        replace(m, position=(m.position @ rotation.T + offset).astype(np.float32), normal=m.normal @ rotation.T)
        for m in scene.meshes
    )
    return replace(scene, meshes=tuple(meshes)), rotation


@pytest.mark.parametrize("distance", [3, 3000])
def test_a_surface_seen_from_far_away_is_lit_as_from_near(distance):
    scene, rotation = turned(Scene((scenes.floor(),), (scenes.WHITE,), environment=WHITE_SKY), np.zeros(3))
    eye = rotation @ np.array([0.3, 1.0, 0.2]) * distance
    camera = look_at(eye, np.zeros(3), rotation @ np.array([0.0, 0.0, -1.0]), 1 / distance, 0.1)
    tracer = Tracer(scene)
    surface = tracer.surface(camera, 16, 16)
    assert surface.valid.all()
    np.testing.assert_allclose(tracer.indirect(*surface.points(), Sampling(32), 0).mean, 1, rtol=1e-5)


def test_kernels_are_compiled_once_whatever_the_views_and_their_points():
    import drjit as dr

    scene = scenes.furnace()
    tracer = Tracer(replace(scene, lights=(light("point"),), environment=WHITE_SKY))

    def trace(width: int, height: int) -> set:
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            surface = tracer.surface(scenes.inside_camera(), width, height)
            tracer.indirect(*surface.points(), Sampling(64, bounces=width % 5), seed=width)
            tracer.direct(*surface.shading_points())
            return {kernel["hash"] for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT}

    first = trace(16, 16)
    assert first
    assert not set().union(*(trace(*size) for size in ((1, 1), (7, 5), (150, 130)))) - first


def test_lights_are_traced_apart_as_if_they_were_alone():
    """Over the surfaces of the whole scene, with the random numbers of a tracer of their own."""
    glow = Material("glow", (0.5, 0.5, 0.5, 1.0), emission=(2.0, 1.0, 0.5))
    lamp = light("point", position=np.array([0.2, 0.5, 0.1]), name="lamp")
    picture = Environment(np.random.default_rng(0).random((4, 8, 3), np.float32))
    room = Scene(
        (*scenes.box()[1:], scenes.floor(0.3, 0.5, 1)), (scenes.WHITE, glow), lights=(lamp,), environment=picture
    )
    room = replace(room, groups={"lamps": ("lamp",), "glow": ("glow",)})
    whole = Tracer(room)
    points = whole.surface(scenes.inside_camera(), 16, 16).points()
    means = []
    for name in ("base", "lamps", "glow"):
        alone = lit_by(room, name)
        lights = [tracer.indirect(*points, Sampling(256), seed=4) for tracer in (whole.lit_by(alone), Tracer(alone))]
        np.testing.assert_array_equal(lights[0].mean, lights[1].mean)
        means.append(lights[0].mean)
    together = whole.indirect(*points, Sampling(256), seed=4).mean
    assert all(mean.mean() > 0.01 * together.mean() for mean in means)
    np.testing.assert_allclose(np.sum(means, axis=0).mean(), together.mean(), rtol=0.05)
