"""Worlds after an edit: two rooms, a sector each, between which no light goes."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
from small_tasks import SURFACE, make_small, see_little

from gsgi.baker.cache.store import Cache
from gsgi.baker.cli import main
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.tasks.request import Request
from gsgi.baker.update.parts import parts
from gsgi.baker.update.plan import NothingToKeepError, check_record
from gsgi.baker.update.record import BakeRecord, find_parts, keep_parts
from gsgi.baker.world.bake import bake_world
from gsgi.baker.world.report import WorldReport
from gsgi.baker.world.world_baker import WorldBaker
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.errors import FileError, FormatError, UsageError
from gsgi.runtime.scene import Material, Scene
from gsgi.runtime.world.world import World

APART, SIZE = 10.0, 6.2
SETTINGS = Settings(budget=32, views=4, size=24, samples=128, error=0, iterations=16, bounces=12)


@pytest.fixture(autouse=True, scope="module")
def small():
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch.setattr)
        see_little(patch.setattr)
        yield


def rooms(*albedos: float | None) -> Scene:
    """Rooms in a row whose walls have these albedos; None: a room is not there. The walls of the first two shine."""
    there = [n for n, albedo in enumerate(albedos) if albedo is not None]
    walls = [Material(f"wall {n}", (*[albedos[n]] * 3, 1.0), emission=(float(n < 2),) * 3) for n in there]
    meshes = [
        replace(mesh, position=mesh.position + np.float32([n * APART, 0, 0]), name=f"room {n}")
        for material, n in enumerate(there)
        for mesh in scenes.box(material=material)
    ]
    return Scene(tuple(meshes), tuple(walls))


def baked(
    scene: Scene, folder: Path, cache: Path, update: Path | None = None, settings: Settings = SETTINGS,
    size: float | None = SIZE,
) -> WorldReport:  # fmt: skip
    folder.mkdir(exist_ok=True)
    output, request = folder / "level.gsgi.json", Request(scene, settings, evaluate=False)
    write = lambda data: write_atomic(output, data)  # noqa: E731
    return bake_world(WorldBaker(request, size, Progress(), Cache(cache), update), output, write)


def light_in(folder: Path, room: int) -> float:
    """The mean B on a wall of a room."""
    with World(folder / "level.gsgi.json") as world:
        world.settle()
        y, z = np.mgrid[-0.8:0.9:0.2, -0.8:0.9:0.2].reshape(2, -1)
        position = np.stack([np.full_like(y, room * APART + 1), y, z], axis=1)
        return float(world.sample(position, np.broadcast_to(-np.eye(3)[0], position.shape)).mean())


@pytest.fixture(scope="module")
def before(small, tmp_path_factory):
    """The folder of a world of two rooms, and a cache."""
    folder = tmp_path_factory.mktemp("world")
    assert baked(rooms(0.5, 0.5), folder / "level", folder / "cache").kept is None
    return folder / "level", folder / "cache"


@pytest.fixture
def level(before, tmp_path):
    """The manifest of a copy of the world and a copy of the cache, which an update may change."""
    for each, name in zip(before, ("level", "cache"), strict=True):
        shutil.copytree(each, tmp_path / name)
    return tmp_path / "level" / "level.gsgi.json", tmp_path / "cache"


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_an_edit_changes_the_files_of_those_sectors_alone_that_it_reaches(level, tmp_path):
    manifest, cache = level
    old, after = files(manifest.parent), rooms(0.8, 0.5)
    report = baked(after, tmp_path / "edited", cache, manifest)
    new = files(tmp_path / "edited")
    assert report.kept == report.as_dict()["kept"] == 1
    assert len(new.keys() & old.keys()) == 2  # the manifest, and the file of the other room
    assert files(manifest.parent) == old
    assert light_in(tmp_path / "edited", 0) == pytest.approx(1 / (1 - 0.8), rel=0.06)
    assert light_in(tmp_path / "edited", 1) == light_in(manifest.parent, 1)
    first, second = (sector["kept"]["samples"] for sector in report.sectors)
    assert first["again"] > 0.9 * sum(first.values())
    assert second["same"] > 0.9 * sum(second.values())  # the rest is on sides on which no point of the thin share is

    again = baked(after, tmp_path / "again", cache, manifest)
    assert (again.found, again.kept, files(tmp_path / "again")) == (2, 1, new)
    back = baked(rooms(0.5, 0.5), tmp_path / "back", cache, tmp_path / "edited" / "level.gsgi.json")
    assert back.kept == 1  # updates can be updated
    assert light_in(tmp_path / "back", 0) == pytest.approx(2, rel=0.06)


def test_without_an_edit_every_file_stays_and_the_manifest_may_be_updated_in_place(level):
    manifest, cache = level
    old = files(manifest.parent)
    assert baked(rooms(0.5, 0.5), manifest.parent, cache, manifest).kept == 2
    assert files(manifest.parent) == old


def test_rooms_that_come_and_go_are_sectors_that_come_and_go(level, tmp_path):
    manifest, cache = level
    more = baked(rooms(0.5, 0.5, 0.3), tmp_path / "more", cache, manifest)
    assert (more.kept, len(more.sectors)) == (2, 3)
    assert light_in(tmp_path / "more", 2) == 0
    less = baked(rooms(None, 0.5, 0.3), tmp_path / "less", cache, tmp_path / "more" / "level.gsgi.json")
    assert len(less.sectors) == 2
    assert light_in(tmp_path / "less", 1) == pytest.approx(2, rel=0.06)


NOTHING = {
    "another size": ({"size": 4.0}, "it was baked with --sectors 6.2, now 4; baking all of it"),
    "auto": ({"size": None}, "it was baked with --sectors 6.2, now auto"),
    "settings": ({"settings": replace(SETTINGS, seed=1)}, "it was baked with other settings: seed 0, now 1"),
    "another scene": ({"scene": rooms(0.5, None, 0.5, 0.5, 0.5)}, "it is of another scene, or nearly: 25% of the"),
    "an empty cache": ({"cache": Path("none")}, "the cache none knows nothing of its bake"),
}


@pytest.mark.parametrize("why", NOTHING)
def test_where_nothing_can_be_kept_one_line_says_why(level, tmp_path, monkeypatch, why):
    manifest, cache = level
    change, message = NOTHING[why]

    def stopped(*_):
        raise KeyboardInterrupt

    told = []
    monkeypatch.setattr(WorldBaker, "plan", stopped)
    monkeypatch.setattr(Progress, "warn", lambda _, line: told.append(line))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        baked(**({"scene": rooms(0.5, 0.5), "folder": tmp_path / "new", "cache": cache, "update": manifest} | change))
    (line,) = told
    assert line.startswith(f"{manifest}: ")
    assert message in line


def test_a_sector_whose_samples_the_cache_has_lost_is_baked_as_a_whole(level, tmp_path):
    manifest, cache = level
    lost = max(cache.glob("layer-*"), key=lambda path: path.stat().st_mtime_ns)  # of the last sector
    lost.unlink()
    report = baked(rooms(0.5, 0.5), tmp_path / "new", cache, manifest)
    assert report.kept == 1
    (warning,) = report.warnings
    assert f"the cache {cache} no longer holds its samples; baking all of it" in warning
    assert light_in(tmp_path / "new", 1) == pytest.approx(2, rel=0.06)


def test_a_sector_is_no_bake_of_the_scene_as_a_whole(level, tmp_path):
    manifest, cache = level
    data = next(manifest.parent.glob("level.0-*.gsgi")).read_bytes()
    scene = rooms(0.5, 0.5)
    with pytest.raises(NothingToKeepError, match="it is a sector of a world"):
        check_record(BakeRecord.find(Cache(cache), data), scene, SETTINGS, {}, parts(scene), Cache(cache))


def test_a_sector_that_grows_is_baked_as_a_whole(level, tmp_path):
    manifest, cache = level
    more = rooms(0.5, 0.5)
    annex = [replace(mesh, position=mesh.position * 0.5 + np.float32([12, 0, 0])) for mesh in scenes.box(material=1)]
    report = baked(replace(more, meshes=(*more.meshes, *annex)), tmp_path / "new", cache, manifest)
    assert (report.kept, len(report.sectors)) == (0, 2)
    assert "kept" not in report.sectors[1]


def test_what_records_need_outlives_them_in_a_cache(tmp_path):
    made = parts(rooms(0.5))
    cache = Cache(tmp_path, limit=1)
    key = keep_parts(cache, made)
    again = Cache(tmp_path, limit=1)
    assert keep_parts(again, made) == key
    again.trim()
    assert find_parts(again, key) == made


def test_manifests_and_files_that_lie_are_refused(level, tmp_path, capsys, monkeypatch):
    manifest, cache = level
    asked = rooms(0.5, 0.5), tmp_path / "new", cache
    with pytest.raises(UsageError, match=r"--update .*: expected the manifest of a world, a \.json file"):
        baked(*asked, manifest.with_suffix(""))
    output = tmp_path / "single.gsgi"
    arguments = ["bake", *SURFACE, "-o", str(output), "--update", str(manifest), "--cache", str(cache), "--quiet"]
    assert main.run(arguments) == 1
    assert "level.gsgi.json: is the manifest of a world; give --sectors too" in capsys.readouterr().err
    first = next(manifest.parent.glob("level.0-*.gsgi"))
    data = first.read_bytes()
    first.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    monkeypatch.setattr(WorldBaker, "sector", lambda *_: pytest.fail("baked"))
    with pytest.raises(FormatError, match="sha256: expected"):
        baked(*asked, manifest)
    first.unlink()
    with pytest.raises(FileError, match=r"level\.0-.* is missing"):
        baked(*asked, manifest)
    assert not (tmp_path / "new" / "level.gsgi.json").exists()
