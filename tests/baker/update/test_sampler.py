"""The samples of a scene after an edit: two rooms, of which one stays as it is."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import scenes
from traced_paths import counted

from gsgi.baker.cache.store import Cache
from gsgi.baker.surface import chunks, samples
from gsgi.baker.surface.budget import PATHS_STEP
from gsgi.baker.surface.layers import Points
from gsgi.baker.surface.samples import Sampler
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.update import sampler as updating
from gsgi.baker.update import tally
from gsgi.baker.update.kept import KeptChunk
from gsgi.baker.update.look_again import look_again
from gsgi.baker.update.parts import met_anew, parts
from gsgi.baker.update.sampler import UpdatedSampler
from gsgi.baker.update.tally import Tally
from gsgi.baker.update.thin_share import SHARE
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.scene import Material, Mesh, Scene

CHUNK, BOUNCES, APART = 1 << 12, 3, 10.0
LAYERS = 2
EVERYWHERE = np.array([[[-100.0] * 3, [100.0] * 3]])


@pytest.fixture(autouse=True, scope="module")
def small_chunks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunks, "CHUNK", CHUNK)
        yield


def ignore(*_):
    """Progress."""


def moved(mesh: Mesh, by) -> Mesh:
    return replace(mesh, position=mesh.position + np.float32(by))


def rooms(albedo: float = 0.5, table: float = -0.5) -> Scene:
    """A room around the origin whose lit walls have an albedo, with a table at z = `table`, and another beside it."""
    walls = [Material(f"wall {n}", (a, a, a, 1.0), emission=(1.0,) * 3) for n, a in enumerate((albedo, 0.5))]
    there = [moved(mesh, [APART, 0, 0]) for mesh in scenes.box(material=1)]
    top = moved(scenes.floor(0.3, -0.5, 2), [0, 0, table])
    wood = Material("wood", (0.1, 0.1, 0.1, 1.0), double_sided=True)
    return Scene((*scenes.box(), *there, top), (*walls, wood))


def cameras() -> list[Camera]:
    """Cameras that see all sides of both rooms."""
    eye, up = np.array([0.0, 0.2, 0.0]), np.array([0.0, 1.0, 0.01])
    aims = [sign * axis for axis in np.eye(3) for sign in (-1, 1)]
    rooms = np.zeros(3), np.array([APART, 0.0, 0.0])
    return [
        look_at(eye + at, eye + at + aim, up[[0, 2, 1]] if aim[1] else up, 1.6, 0.01) for at in rooms for aim in aims
    ]


def sampler(scene: Scene, cache: Cache) -> Sampler:
    light = CachedTracer(scene, cache)
    return Sampler.gathering(light, SeenSurface(light, cameras()), BOUNCES, 0, 0.0, ([1], [1, 1]))


def updated(
    scene: Scene, before: list, cache: Cache, count: Tally | None = None, anew: np.ndarray = EVERYWHERE
) -> UpdatedSampler:
    light = CachedTracer(scene, cache)
    return UpdatedSampler.gathering(light, SeenSurface(light, cameras()), BOUNCES, 0, before, count or Tally(), anew)


def both(of, layers: int = LAYERS):
    """The samples on surfaces and in free space."""
    of.prepare(ignore)
    return of.surface([layers], ignore), of.free([1], ignore)


def entries(of) -> list:
    return [each.entries for each in of.chain]


def same(a, b, where=slice(None)):
    for name in samples.ARRAYS:
        np.testing.assert_array_equal(getattr(a, name)[where], getattr(b, name)[where], err_msg=name)


@pytest.fixture(scope="module")
def before(small_chunks, tmp_path_factory):
    """A cache that has the samples of the rooms, their entries, and the samples."""
    cache = Cache(tmp_path_factory.mktemp("cache"))
    first = sampler(rooms(), cache)
    return cache, both(first), entries(first)


def test_samples_in_spots_are_updated_with_the_others(tmp_path):
    cache = Cache(tmp_path)
    first = sampler(rooms(), cache)
    kept, _ = both(first)
    some = first.spots(__name__, lambda points, _: points.at(slice(0, None, 300)), Points)
    spots = first.at_spots(some, LAYERS)
    assert 100 < len(spots) < 200
    unchanged, edited = (updated(rooms(a), entries(first), cache) for a in (0.5, 0.8))
    same(both(unchanged)[0], kept)
    same(unchanged.kept_at_spots, spots)
    both(edited)
    again = edited.kept_at_spots
    far = spots.position[:, 0] > APART / 2
    same(again, spots, far)
    assert 0.2 < far.mean() < 0.8
    assert (again.indirect.mean(axis=1) > 1.2 * spots.indirect.mean(axis=1))[~far].all()
    assert len(entries(edited)[-1]["spots-0"]) == 1


def test_without_an_edit_all_samples_are_kept_and_only_a_thin_share_is_traced(before, monkeypatch):
    cache, kept, there = before
    paths, count = counted(monkeypatch), Tally()
    found = both(updated(rooms(), there, cache, count))
    for a, b in zip(found, kept, strict=True):
        same(a, b)
    assert sum(paths) == 5 * CHUNK // SHARE * PATHS_STEP  # three chunks of known light, and one of each stage
    assert not any(numbers[tally.SHIFTED :].any() for numbers in count.points.values())


@pytest.mark.parametrize("edit", [{"albedo": 0.55}, {"table": 0.2}], ids=["colours", "a table moved"])
def test_points_are_looked_for_only_where_the_edit_may_be_met(tmp_path, monkeypatch, edit):
    first = sampler(rooms(), Cache(tmp_path / "all"))
    both(first)
    shutil.copytree(tmp_path / "all", tmp_path / "some")
    scene, looked = rooms(**edit), []
    found = both(updated(scene, entries(first), Cache(tmp_path / "all")))
    behind = SeenSurface.behind
    monkeypatch.setattr(SeenSurface, "behind", lambda *given: looked.append(len(given[1])) or behind(*given))
    anew = met_anew(parts(rooms()), parts(scene))
    quick = both(updated(scene, entries(first), Cache(tmp_path / "some"), anew=anew))
    for new, old in zip(quick, found, strict=True):
        same(new, old)
    assert sum(looked) < CHUNK  # of five chunks
    assert bool(looked) == ("table" in edit)


def test_what_has_gone_and_come_back_is_seen_again(tmp_path):
    """The walls of one room: without them nothing is seen where they were."""
    cache, whole = Cache(tmp_path), rooms()
    less = replace(whole, meshes=tuple(mesh for mesh in whole.meshes if mesh.bounds()[0][0] < APART / 2))
    first = sampler(whole, cache)
    both(first)
    made = entries(first)
    for before, after, there in ((whole, less, False), (less, whole, True)):
        update = updated(after, made, cache, anew=met_anew(parts(before), parts(after)))
        surface, _ = both(update)
        assert (surface.position[:, 0] > APART / 2).any() == there
        made = entries(update)
    assert 0.3 < (surface.position[:, 0] > APART / 2).mean() < 0.7


def test_points_without_light_are_looked_for_wherever_an_edit_is(before):
    cache, _, there = before
    chunk = KeptChunk.found(cache, there[-1]["surface-0"])
    nothing = np.full_like(chunk.position, np.nan)
    lost = replace(chunk, position=nothing, indirect_a=nothing, indirect_b=nothing)
    far = np.array([[[50.0] * 3, [60.0] * 3]])
    seen = SeenSurface(CachedTracer(rooms(), cache), cameras())
    ((points, fate),) = look_again(seen, far, [lost], on_surfaces=True)
    np.testing.assert_array_equal(points.position, chunk.position)
    assert (fate == tally.NEW).all()
    ((_, fate),) = look_again(seen, far[:0], [lost], on_surfaces=True)
    assert (fate == tally.GONE).all()


def test_a_room_that_no_path_leaves_keeps_its_bits_while_the_other_is_traced_again(before):
    cache, kept, there = before
    count = Tally()
    found = both(updated(rooms(albedo=0.8), there, cache, count))
    for new, old in zip(found, kept, strict=True):
        far = old.position[:, 0] > APART / 2
        assert 0.3 < far.mean() < 0.7
        same(new, old, far)
    light = found[0].indirect[found[0].position[:, 0] < APART / 2].mean()
    truth = both(sampler(rooms(albedo=0.8), Cache()))[0]
    np.testing.assert_allclose(light, truth.indirect[truth.position[:, 0] < APART / 2].mean(), rtol=0.02)
    assert count.points["samples"][tally.AGAIN] > 0.3 * CHUNK


def test_layers_that_share_launches_keep_their_bits(before, tmp_path, monkeypatch):
    cache, _, there = before
    alone, together = [], []
    for found, most in ((alone, 1), (together, updating.TOGETHER)):
        monkeypatch.setattr(updating, "TOGETHER", most)
        own = Cache(shutil.copytree(cache.folder, tmp_path / str(most)))
        found += both(updated(rooms(albedo=0.8), there, own))
    for a, b in zip(alone, together, strict=True):
        same(a, b)


def test_samples_follow_an_object_that_has_moved(before):
    cache, kept, there = before
    count, scene = Tally(), rooms(table=0.5)
    surface, free = both(updated(scene, there, cache, count))
    on_table = (np.abs(surface.position[:, 1] + 0.5) < 1e-5) & (np.abs(surface.position[:, 0]) < 0.35)
    assert on_table.any()
    assert (surface.position[on_table, 2] > 0.15).all()
    assert count.points["samples"][tally.NEW] >= on_table.sum()
    truth = both(sampler(scene, Cache()))
    for found, expected in zip((surface, free), truth, strict=True):
        near = found.position[:, 0] < APART / 2, expected.position[:, 0] < APART / 2
        light, right = (each.indirect[here].mean() for each, here in zip((found, expected), near, strict=True))
        np.testing.assert_allclose(light, right, rtol=0.02)
    covered = (free.position[:, 1] < -0.5) & (np.abs(free.position[:, [0, 2]] - [0, 0.5]) < 0.2).all(axis=1)
    old = (kept[1].position[:, 1] < -0.5) & (np.abs(kept[1].position[:, [0, 2]] - [0, 0.5]) < 0.2).all(axis=1)
    assert covered.sum() < old.sum()


def test_an_update_is_repeatable_resumes_and_can_be_updated(before):
    cache, kept, there = before
    scene = rooms(albedo=0.8)
    first = updated(scene, there, cache)
    found = both(first)
    for a, b in zip(both(updated(scene, there, cache)), found, strict=True):
        same(a, b)
    back = both(updated(rooms(), entries(first), cache))
    for again, old in zip(back, kept, strict=True):
        far = old.position[:, 0] > APART / 2
        same(again, old, far)
        np.testing.assert_allclose(again.indirect[~far].mean(), old.indirect[~far].mean(), rtol=0.01)


def test_what_an_object_has_covered_is_traced_where_it_has_left_again(before):
    cache, kept, there = before
    first = updated(rooms(table=0.5), there, cache)
    both(first)
    for back, old in zip(both(updated(rooms(), entries(first), cache)), kept, strict=True):
        assert len(back) == len(old)
        np.testing.assert_array_equal(back.position, old.position)
        np.testing.assert_allclose(back.indirect.mean(), old.indirect.mean(), rtol=0.01)


def test_small_changes_are_followed_along_the_first_paths_alone(tmp_path):
    cache, layers, count = Cache(tmp_path), 2, Tally()
    first = sampler(rooms(), cache)
    both(first, layers)
    scene = rooms(albedo=0.55)  # 1 / (1 - 0.5) becomes 1 / (1 - 0.55): 11 % more
    found = both(updated(scene, entries(first), cache, count), layers)[0]
    assert count.points["samples"][tally.PART] > 0.3 * CHUNK
    truth = both(sampler(scene, Cache()), layers)[0]
    light, right = (each.indirect[each.position[:, 0] < APART / 2].mean() for each in (found, truth))
    np.testing.assert_allclose(light, right, rtol=0.01)
