"""Bakes in sectors: their files and manifest, what an interruption leaves, and light without a seam."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
from repository import SCENES
from small_tasks import SURFACE, TINY, make_small, see_little

from gsgi.baker import estimate
from gsgi.baker.cache.store import Cache
from gsgi.baker.cli import main
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.tasks.request import Request
from gsgi.baker.world import bake, world_baker
from gsgi.baker.world.report import WorldReport
from gsgi.baker.world.world_baker import WorldBaker
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.manifest import read_manifest
from gsgi.runtime.world.world import World

SETTINGS = Settings(budget=32, views=4, size=24, samples=128, error=0, iterations=16, bounces=8)
LENGTH, ALBEDO = 2.0, 0.5  # of the furnace, relative to its width; of its walls
LIGHT = 1 / (1 - ALBEDO)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    make_small(monkeypatch.setattr)
    see_little(monkeypatch.setattr)


def long_furnace() -> Scene:
    """A closed hall, all of whose walls have the same light: it is known everywhere."""
    scene = scenes.furnace(ALBEDO)
    stretched = (replace(mesh, position=mesh.position * np.float32([LENGTH, 1, 1])) for mesh in scene.meshes)
    return replace(scene, meshes=tuple(stretched))


def bake_hall(folder: Path, cache: Path, evaluate: bool = False) -> WorldReport:
    folder.mkdir(exist_ok=True)
    request, output = Request(long_furnace(), SETTINGS, evaluate=evaluate), folder / "level.gsgi.json"
    write = lambda data: write_atomic(output, data)  # noqa: E731
    return bake.bake_world(WorldBaker(request, 2.5, Progress(), Cache(cache)), output, write)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_bake_in_sectors_is_resumed_and_its_manifest_comes_last(tmp_path, monkeypatch):
    whole, again, cache = tmp_path / "whole", tmp_path / "again", tmp_path / "other cache"
    report = bake_hall(whole, tmp_path / "cache", evaluate=True)
    assert read_manifest(whole / "level.gsgi.json") == report.manifest
    assert [sector.neighbours for sector in report.manifest.sectors] == [(1,), (0,)]
    assert len(contents(whole)) == 3
    assert report.gaussians == sum(sector["gaussians"] for sector in report.as_dict()["sectors"]) > 8

    number, view = report.worst
    assert number in (0, 1)
    assert view["final"]["psnr"] > 25  # of what lies in the sector
    assert json.dumps(report.as_dict())
    baked = WorldBaker.sector

    def interrupted(self, number, progress):
        if number:
            raise KeyboardInterrupt
        return baked(self, number, progress)

    again.mkdir()
    older = {"level.gsgi.json": b"{}", "level.7-0123456789ab.gsgi": b"old", "level.other.gsgi": b"mine"}
    for name, data in older.items():
        (again / name).write_bytes(data)
    with monkeypatch.context() as context:
        context.setattr(WorldBaker, "sector", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bake_hall(again, cache)
    assert older.items() <= contents(again).items()
    assert len(contents(again)) == len(older) + 1

    assert bake_hall(again, cache).found == 1
    assert contents(again) == contents(whole) | {"level.other.gsgi": b"mine"}
    with World(whole / "level.gsgi.json") as world:
        world.settle()
        hall_is_even(world)


def hall_is_even(world: World) -> None:
    """The light is that of a furnace, and goes on across the border."""
    rng = np.random.default_rng(0)
    position = rng.uniform(-1, 1, (3000, 3)) * [LENGTH, 1, 1]
    axis = 1 + rng.integers(2, size=3000)
    side = np.sign(position[np.arange(3000), axis])
    position[np.arange(3000), axis] = side
    normal = -side[:, None] * np.eye(3)[axis]
    light = world.sample(position, normal)
    assert np.abs(light / LIGHT - 1).mean() < 0.04
    near = np.abs(position[:, 0]) < world.manifest.margin
    assert near.sum() > 60
    assert np.abs(light[near] / LIGHT - 1).mean() < 0.06
    position[:, 0] = 0
    left, right = (world.sample(position + np.float64([shift, 0, 0]), normal) for shift in (-1e-6, 1e-6))
    assert np.abs(right - left).max() < 0.01 / 255


REFUSED = {
    "level.gsgi": ([], "expected a name that ends in .json for the manifest of sectors"),
    ".gsgi.json": ([], "expected a name that ends in .json for the manifest of sectors"),
    "a.json": (["--target-loss", "0.1"], "--target-loss: cannot be had with --sectors"),
    "d.json": (["--operator", "over"], "--operator over: cannot be baked in sectors"),
    "e.json": (["--group", "sky=environment"], "--group: cannot be baked in sectors"),
    "f.json": (["--sectors", "0.01"], "--sectors 0.01: makes 8120601 sectors, and a world has at most 4096"),
}


@pytest.mark.parametrize("output", REFUSED)
def test_what_cannot_be_had_in_sectors_is_refused(tmp_path, output, capsys):
    more, message = REFUSED[output]
    flags = [*SURFACE, "--sectors", "1", "-o", str(tmp_path / output), "--cache", str(tmp_path / "cache"), *more]
    assert main.run(["bake", *flags, "--quiet"]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / output).exists()


def test_a_plan_tells_how_the_scene_is_divided(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(estimate, "estimate", lambda plan: {"fit": 2.0})
    flags = [*TINY, "--sectors", "10.5", "--cache", str(tmp_path), "--quiet", "--json"]
    assert main.run(["plan", str(SCENES / "corridor.glb"), *flags]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert (rows[0]["what"], rows[0]["decision"]) == ("sectors", "2")
    assert "2 sectors of 3.44 x 2.64 x 10.1 m, which meet in borders of 0.84 m" in rows[0]["why"]
    assert rows[-1]["why"].startswith("each of 2, on this machine")


def test_cameras_belong_to_the_sector_in_which_they_stand():
    cameras = scenes.furnace().cameras | {"above": scenes.above_camera()}
    assert list(world_baker._within(np.array([[0, -1, 0], [1, 1, 1.0]]), cameras)) == ["inside"]
