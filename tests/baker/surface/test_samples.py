"""Where the `surface` operator is fitted: on what cameras see, by area, in two halves that are independent."""

import numpy as np
import pytest
import scenes
from traced_paths import counted

from gsgi.baker.cache.store import Cache, entries
from gsgi.baker.surface import budget, chunks, samples, seen_surface
from gsgi.baker.surface.budget import (
    COARSE_MOST,
    COARSE_SHARE,
    FREE_LAYERS,
    FREE_PER_GAUSSIAN,
    KNOWN_PER_GAUSSIAN,
    PATHS_STEP,
)
from gsgi.baker.surface.chunks import free_layers, known_rounds, path_count, point_count, surface_layers
from gsgi.baker.surface.samples import Sampler, SurfaceSamples, joined
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.trace import cached_tracer, known_light
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.tracer import BOUNCES_MAX, Tracer
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.scene import Environment, Material, Scene

CHUNK = 4096
GAUSSIANS = 2 * CHUNK // KNOWN_PER_GAUSSIAN  # of which known light takes one chunk, then two
BOUNCES = 2
ARRAYS = samples.ARRAYS
UP = np.array([0.0, 0.0, -1.0])


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(chunks, "CHUNK", CHUNK)


def ignore(*_):
    """Progress."""


def sampler(scene: Scene, cameras=(), cache=None, bounces=BOUNCES, seed=0) -> Sampler:
    light = CachedTracer(scene, cache or Cache())
    return Sampler(light, SeenSurface(light, cameras or [scenes.inside_camera()]), bounces, seed)


@pytest.fixture
def traced(monkeypatch) -> list[int]:
    """The number of paths of each call of a tracer."""
    return counted(monkeypatch)


def above(eye, yfov: float) -> Camera:
    """Looks straight down."""
    return look_at(np.array(eye), np.array(eye) - [0, 1, 0], UP, yfov, 0.01)


def assert_same(a: SurfaceSamples, b: SurfaceSamples):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_a_chunk_is_the_same_whatever_else_is_asked_for():
    one, two = sampler(scenes.furnace()), sampler(scenes.furnace())
    first = one.surface([1], ignore)
    free = two.free([1], ignore)
    both = two.surface([1, 1], ignore)
    assert (len(first), len(both)) == (CHUNK, 2 * CHUNK)
    assert_same(both[:CHUNK], first)
    assert_same(one.free([1], ignore), free)
    assert (both.position[CHUNK:] != first.position).any()
    assert (both.indirect_a[CHUNK:] != first.indirect_a).mean() > 0.9
    other = sampler(scenes.furnace(), seed=1).surface([1], ignore)
    assert (other.position != first.position).any()
    assert (other.indirect_a != first.indirect_a).mean() > 0.9


def test_layers_are_new_paths_from_the_same_points():
    """In a closed box that emits 1 at albedo 1/2, four times the paths have at most half the noise."""
    one, four = (sampler(scenes.furnace()).surface([layers], ignore) for layers in (1, 4))
    np.testing.assert_array_equal(four.position, one.position)
    assert 0.3 < four.indirect_a[:, 0].std() / one.indirect_a[:, 0].std() < 0.5
    assert abs(np.corrcoef(four.indirect_a[:, 0], four.indirect_b[:, 0])[0, 1]) < 0.06  # standard error 0.016


def test_free_space_takes_few_layers_of_each_chunk(traced):
    for count, times in ((1, 1), (2, 2), (3, 4), (4, 8), (5, 12)):
        gaussians = times * CHUNK // FREE_PER_GAUSSIAN * COARSE_SHARE
        assert free_layers(gaussians, 100 * PATHS_STEP) == [FREE_LAYERS] * count
        assert free_layers(gaussians, 1) == [1] * count
    assert len(sampler(scenes.furnace()).free([1, 1], ignore)) == 2 * CHUNK
    assert sum(traced) == path_count([1, 1]) == 2 * CHUNK * PATHS_STEP


def test_every_surface_sample_takes_whole_layers(traced, monkeypatch):
    monkeypatch.setattr(budget, "SAMPLES_FEWEST", CHUNK + 1)
    layers = surface_layers(1, PATHS_STEP + 1)
    assert layers == [2, 2]
    assert len(sampler(scenes.furnace()).surface(layers, ignore)) == 2 * CHUNK
    assert sum(traced) == path_count(layers) == 2 * CHUNK * 2 * PATHS_STEP
    assert surface_layers(1, 1) == [1, 1]
    assert point_count(free_layers(COARSE_SHARE * COARSE_MOST, 1)) == FREE_PER_GAUSSIAN * COARSE_MOST


def test_what_the_cache_holds_is_not_traced_again(tmp_path):
    scene, cache = scenes.furnace(), Cache(tmp_path)
    done = []
    first = sampler(scene, cache=cache).surface([1, 2], lambda *args: done.append(args[0]))
    assert sum(done) == pytest.approx(path_count([1, 2]))
    assert len(entries(tmp_path)) == 2 + 3 + 1  # the points of each chunk, layers, and which lights matter where
    light, done = CachedTracer(scene, cache), []
    light.__dict__["tracer"] = None  # whoever asks it for anything fails
    inside = SeenSurface(light, [scenes.inside_camera()])
    again = Sampler(light, inside, BOUNCES, 0)
    assert_same(again.surface([1, 2], lambda *args: done.append(args[0])), first)
    assert sum(done) == path_count([1, 2])
    for other in (
        Sampler(light, SeenSurface(light, [above([0.0, 0.5, 0.0], 1.0)]), BOUNCES, 0),
        Sampler(light, inside, BOUNCES + 1, 0),
        Sampler(light, inside, BOUNCES, 1),
        Sampler(light, SeenSurface(light, [scenes.inside_camera()], [True]), BOUNCES, 0),
    ):
        with pytest.raises(AttributeError):
            other.surface([1], ignore)
    for layers in ([2], [1, 2, 1]):
        with pytest.raises(AttributeError):
            again.surface(layers, ignore)
    with pytest.raises(AttributeError):
        again.free([1], ignore)


def test_more_samples_trace_only_the_difference(tmp_path, traced):
    scene, cache = scenes.furnace(), Cache(tmp_path)
    sampler(scene, cache=cache).surface([1, 1], ignore)
    traced.clear()
    more = sampler(scene, cache=cache).surface([2, 2, 2], ignore)
    assert sum(traced) == path_count([1, 1, 2])
    traced.clear()
    sampler(scene, cache=cache).surface([1], ignore)
    assert not traced
    assert_same(more, sampler(scene).surface([2, 2, 2], ignore))


def test_scene_and_cameras_are_hashed_once(tmp_path, monkeypatch):
    hashed = []
    for module, name in ((cached_tracer, "scene_digest"), (seen_surface, "digest")):
        original = getattr(module, name)
        monkeypatch.setattr(module, name, lambda value, f=original, name=name: (hashed.append(name), f(value))[1])
    asked = sampler(scenes.furnace(), cache=Cache(tmp_path))
    asked.surface([1, 2], ignore)
    asked.free([1], ignore)
    assert sorted(hashed) == ["digest", "scene_digest"]


def test_where_no_path_gives_a_number_there_is_no_sample(monkeypatch):
    """One layer of one half at point 0; both layers of that half at point 1."""
    trace, call = Tracer.indirect, iter(range(4))

    def broken(*arguments):
        light, layer, half = trace(*arguments), *divmod(next(call), 2)
        if not half:
            light.samples[:2], light.mean[:2] = 0, 0
            light.samples[0], light.mean[0] = 16 * layer, 3 * layer
        return light

    monkeypatch.setattr(Tracer, "indirect", broken)
    found = sampler(scenes.furnace()).surface([2], ignore)
    assert len(found) == CHUNK - 1
    np.testing.assert_array_equal(found.indirect_a[0], 3)


def test_samples_lie_on_the_surfaces_that_a_camera_sees():
    camera = scenes.inside_camera()
    samples = sampler(scenes.furnace()).surface([1], ignore)
    np.testing.assert_allclose(np.abs(samples.position).max(axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(samples.normal, axis=1), 1, rtol=1e-5)
    wall = np.abs(samples.position).argmax(axis=1)
    inward = -samples.position[np.arange(CHUNK), wall]
    np.testing.assert_allclose(samples.normal[np.arange(CHUNK), wall], inward, atol=1e-5)
    view = samples.position @ camera.view_from_world[:3, :3].T + camera.view_from_world[:3, 3]
    slope = np.abs(view[:, :2]) / -view[:, 2:]
    assert (view[:, 2] < 0).all()
    assert slope.max() <= np.tan(camera.yfov / 2)


def test_a_floor_is_sampled_evenly_also_at_the_edges_of_a_wide_image():
    """The camera sees 3.1 m of it from 1 m above: at the corners a pixel covers as much as in the middle."""
    camera = above([0.0, 1.0, 0.0], 2.0)
    samples = sampler(Scene((scenes.floor(5.0),), (scenes.WHITE,)), [camera]).surface([1], ignore)
    half = np.tan(1.0)
    distance = np.abs(samples.position[:, [0, 2]]).max(axis=1)
    assert distance.max() < half
    for share in (0.25, 0.5, 0.75):  # of the width; whole pixels
        assert (distance < share * half).mean() == pytest.approx(share**2, abs=0.01)  # stratified


def test_a_wall_of_twice_the_area_gets_twice_the_samples():
    """Whatever the distance, and however it is turned to the camera."""
    slope = 3.0
    # 2 x 1 m, level; and 1 m x 1 m in its own plane, nearer to the camera, but steep.
    level = scenes.quad([(-2.2, 0, 0.5), (-0.2, 0, 0.5), (-0.2, 0, -0.5), (-2.2, 0, -0.5)])
    run = 1 / np.sqrt(1 + slope**2)
    steep = scenes.quad(
        [(0.3, 2, 0.5), (0.3 + run, 2 - slope * run, 0.5), (0.3 + run, 2 - slope * run, -0.5), (0.3, 2, -0.5)]
    )
    eye = [0.0, 4.0, 0.0]
    samples = sampler(Scene((level, steep), (scenes.WHITE,)), [above(eye, 1.1)]).surface([1], ignore)
    on_level = samples.position[:, 1] < 1e-3
    # Edges fall between the pixels of an image of 64 px, in which the smaller wall is some 6 px wide.
    assert on_level.sum() / (~on_level).sum() == pytest.approx(2, rel=0.12)


def test_what_two_cameras_see_gets_twice_the_samples():
    floor = Scene((scenes.floor(5.0),), (scenes.WHITE,))
    eyes = [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [4.0, 1.0, 0.0]
    samples = sampler(floor, [above(eye, 0.8) for eye in eyes]).surface([1], ignore)
    assert (samples.position[:, 0] < 2).mean() == pytest.approx(2 / 3, abs=0.01)


def test_free_samples_lie_in_free_space_and_face_every_way():
    solid = scenes.box(0.3, inward=False)
    camera = scenes.inside_camera()
    samples = sampler(Scene((*scenes.box(), *solid), (scenes.WHITE,)), [camera]).free([1], ignore)
    assert len(samples) == CHUNK
    assert np.abs(samples.position).max() < 1
    assert np.abs(samples.position).max(axis=1).min() > 0.3  # not inside the solid one
    shadow = samples.position[:, 2] < -0.3  # nor behind it, as seen from the camera
    way = (samples.position - camera.position)[shadow]
    front = camera.position + way * ((0.3 - camera.position[2]) / way[:, 2:])
    assert (np.abs(front[:, :2]).max(axis=1) > 0.3 - 1e-4).all()
    normal = samples.normal.astype(float)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-5)
    np.testing.assert_allclose(normal.mean(axis=0), 0, atol=0.05)  # standard error 0.009
    np.testing.assert_allclose(normal.T @ normal / CHUNK, np.eye(3) / 3, atol=0.05)


@pytest.mark.parametrize("kind", ["surface", "free"])
def test_halves_are_independent_and_right_on_average(kind):
    """In a closed box that emits 1 at albedo 1/2 there is B = 2 everywhere, for every normal."""
    asked = sampler(scenes.furnace(), bounces=BOUNCES_MAX)
    samples = asked.surface([1], ignore) if kind == "surface" else asked.free([1], ignore)
    a, b = (half[:, 0] - 2.0 for half in (samples.indirect_a, samples.indirect_b))
    assert min(a.std(), b.std()) > 0.02
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.06  # standard error 0.016
    for error in (a, b):
        assert abs(error.mean()) < 6 * error.std() / np.sqrt(CHUNK)
    np.testing.assert_allclose(samples.indirect, (samples.indirect_a + samples.indirect_b) / 2)
    assert samples.indirect[:, 0].std() == pytest.approx(a.std() / np.sqrt(2), rel=0.1)
    assert samples.invalid == 0


def test_light_in_free_space_depends_on_the_normal():
    """Over a floor that emits 1, under a black sky: a normal with cosine c to it sees (1 - c) / 2 of B = 1."""
    lamp = Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(1.0, 1.0, 1.0))
    scene = Scene((scenes.floor(1000.0),), (lamp,))
    samples = sampler(scene, [above([0.0, 3.0, 0.0], 0.5)], bounces=BOUNCES_MAX).free([8], ignore)
    expected = (1 - samples.normal[:, 1]) / 2
    np.testing.assert_allclose(samples.indirect[:, 0], expected, atol=0.15)
    assert abs((samples.indirect[:, 0] - expected).mean()) < 0.005


def test_cameras_that_see_no_surface_give_no_samples():
    sky = Scene((scenes.floor(),), (scenes.WHITE,), environment=Environment(np.ones((1, 1, 3), np.float32)))
    up = look_at(np.array([0.0, 1.0, 0.0]), np.array([0.0, 2.0, 0.0]), UP, 0.8, 0.01)
    asked = sampler(sky, [up])
    assert len(asked.surface([1], ignore)) == len(asked.free([1], ignore)) == 0
    unlit = Scene((scenes.floor(),), (Material(unlit=True),))
    assert len(sampler(unlit, [above([0.0, 1.0, 0.0], 0.8)]).surface([1], ignore)) == 0


def test_parts_of_samples_and_sets_together():
    rng = np.random.default_rng(0)
    samples = SurfaceSamples(*(rng.random((9, 3)).astype(np.float32) for _ in ARRAYS), 4)
    for index in (slice(2, 7, 2), np.arange(9) % 2 == 0, np.array([5, 1])):
        part = samples[index]
        np.testing.assert_array_equal(part.normal, samples.normal[index])
        assert part.indirect_b.flags.c_contiguous
    whole = joined([samples[:4], samples[4:]])
    assert_same(whole, samples)
    assert whole.invalid == 8
    assert len(whole) == 9


def gathering(scene: Scene, bounces=BOUNCES, error=0.0, cache=None) -> Sampler:
    light = CachedTracer(scene, cache or Cache())
    seen, rounds = SeenSurface(light, [scenes.inside_camera()]), known_rounds(bounces, GAUSSIANS)
    return Sampler.gathering(light, seen, bounces, 0, error, rounds)


def prepared(sampler: Sampler) -> Sampler:
    sampler.prepare(ignore)
    return sampler


@pytest.mark.parametrize("bounces", [0, 1, 2, 5])
def test_light_that_ends_in_known_light_has_all_its_bounces(traced, bounces):
    """In a closed box that emits 1 at albedo 1/2, k bounces leave out 2^-(k + 1) of the light."""
    asked = prepared(gathering(scenes.furnace(0.5), bounces))
    assert sum(traced) == PATHS_STEP * CHUNK * (0, 2, 3, 3)[min(bounces, 3)]
    found = asked.surface([1], ignore).indirect.mean()
    left = 2 * 0.5 ** (bounces + 1)
    # Paths that go on, because so few samples leave cells unknown, may end in known light later: a bounce more.
    assert 2 - left == pytest.approx(found, rel=0.01) or 2 - left < found < 2 - left + 0.1 * left


def test_known_light_lowers_the_noise():
    whole = sampler(scenes.furnace(0.8), bounces=16).surface([1], ignore)
    gathered = prepared(gathering(scenes.furnace(0.8), 16)).surface([1], ignore)
    assert gathered.indirect_a[:, 0].std() < 0.8 * whole.indirect_a[:, 0].std()
    assert abs(np.corrcoef(gathered.indirect_a[:, 0], gathered.indirect_b[:, 0])[0, 1]) < 0.1


def test_quiet_points_take_no_further_layers(traced):
    """One layer of 64 paths leaves a noise near a twentieth of the light: half of that takes about four."""
    counts = []
    for error in (10.0, 0.025, 0.0):
        asked, done = prepared(gathering(scenes.furnace(0.5), 4, error)), []
        traced.clear()
        asked.surface([8], lambda paths, *_, done=done: done.append(paths))
        counts.append(sum(traced) / (CHUNK * PATHS_STEP))
        assert sum(done) == pytest.approx(path_count([8]))
    assert counts[0] == 1
    assert counts[-1] == 8
    assert 1 < counts[1] < 8


def test_points_in_free_space_take_more_layers_where_they_are_noisy(traced, monkeypatch):
    """A layer leaves a noise of a thirtieth of the light in a furnace, and of an eighth in a room below a spot."""
    monkeypatch.setattr(samples, "FREE_ERROR", 0.12)
    layers = {}
    for name, scene, error in (
        ("quiet", scenes.furnace(0.5), 0.025), ("noisy", scenes.spot_room(), 0.025), ("all", scenes.furnace(0.5), 0.0),
    ):  # fmt: skip
        asked = prepared(gathering(scene, 4, error))
        assert asked.known_light  # for which paths are traced too
        traced.clear()
        asked.free([FREE_LAYERS], ignore)
        layers[name] = sum(traced) / (CHUNK * PATHS_STEP)
    assert layers["quiet"] == 1
    assert 1.2 < layers["noisy"] < 1.9 < FREE_LAYERS
    assert layers["all"] == FREE_LAYERS


def test_paths_that_are_connected_take_half_of_the_layers(traced, monkeypatch):
    monkeypatch.setattr(known_light, "PAYS", 0.0)
    connected = prepared(gathering(scenes.spot_room()))
    assert connected.connected
    assert not prepared(gathering(scenes.furnace())).connected
    advanced = []
    traced.clear()
    connected.surface([8], lambda paths, *_: advanced.append(paths))
    assert sum(traced) == 4 * PATHS_STEP * CHUNK
    assert sum(advanced) == path_count([8])


def test_gathered_samples_come_from_the_cache(tmp_path, traced):
    cache, scene = Cache(tmp_path), scenes.furnace(0.5)
    first = prepared(gathering(scene, 3, 0.05, cache)).surface([3], ignore)
    traced.clear()
    done = []
    again = gathering(scene, 3, 0.05, cache)
    again.prepare(lambda paths, *_: done.append(paths))
    assert sum(done) == pytest.approx(sum(map(path_count, known_rounds(3, GAUSSIANS))))
    assert_same(again.surface([3], ignore), first)
    assert not traced


def test_other_light_is_traced_at_the_same_points(tmp_path, traced):
    """Also those by which known light is found. A dim sky does not lack the paths that only it needs."""
    sky, cache = Environment(np.full((1, 1, 3), 1e-3, np.float32)), Cache(tmp_path)
    glow = Material("glow", (0.5, 0.5, 0.5, 1.0), emission=(10.0, 10.0, 10.0))
    meshes, groups = (*scenes.box()[1:], scenes.floor(0.2, -0.5, 1)), {"sky": ("environment",)}
    room = Scene(meshes, (scenes.WHITE, glow), environment=sky, groups=groups)
    light = CachedTracer(room, cache)
    seen = SeenSurface(light, [scenes.inside_camera()])
    whole = Sampler.gathering(light, seen, BOUNCES, 0, 0.02, known_rounds(BOUNCES, GAUSSIANS))
    whole.prepare(ignore)
    apart = whole.lit_by(light.lit_by("sky"))
    assert not apart.prepared
    apart.prepare(ignore)
    every, dim = (one.surface([8], ignore) for one in (whole, apart))
    for name in ("position", "normal"):
        np.testing.assert_array_equal(getattr(dim, name), getattr(every, name))
    np.testing.assert_allclose(dim.indirect.mean(), 1e-3 * 0.5, rtol=0.9)
    assert dim.indirect.mean() < 0.01 * every.indirect.mean()
    noise = np.abs(dim.indirect_a - dim.indirect_b).mean() / dim.indirect.mean()
    assert noise < 0.1
    traced.clear()
    again = Sampler.gathering(CachedTracer(room, cache), seen, BOUNCES, 0, 0.02, known_rounds(BOUNCES, GAUSSIANS))
    again.prepare(ignore)
    again = again.lit_by(light.lit_by("sky"))
    again.prepare(ignore)
    assert_same(again.surface([8], ignore), dim)
    assert not traced
