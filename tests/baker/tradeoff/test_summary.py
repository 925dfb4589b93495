"""Several studies as one rank table."""

import json

import pytest

from gsgi.baker.cli import main
from gsgi.baker.cli.commands import tradeoff
from gsgi.baker.tradeoff import summary

METHODS = "surface", "lightmap", "ambient", "path-tracing"


def entry(method: str, ssim: float, ms: float, size: int, seconds: float) -> dict:
    return {
        "method": method, "label": f"setting of {method}", "mean": {"ssim": ssim}, "frame_ms": 10 + ms, "more_ms": ms,
        "file_bytes": size, "gpu_bytes": size, "bake_seconds": seconds,
    }  # fmt: skip


def study(*entries: dict, goal: float = 0.95) -> dict:
    return {
        "scene": {"name": "room <1>.glb"}, "ceiling": 0.99, "entries": list(entries),
        "methods": [{"name": name, "title": f"the {name}"} for name in METHODS],
        "ranking": {str(goal): [i for i, each in enumerate(entries) if each["mean"]["ssim"] >= goal]},
        "about": {"version": "1", "commit": "c", "processor": "p", "cores": 2, "driver": "d"},
    }  # fmt: skip


STUDIES = {
    "room": study(
        entry("surface", 0.96, 4, 2000, 10),
        entry("lightmap", 0.97, 1, 90000, 40),
        entry("path-tracing", 0.98, 900, 0, 1),
        entry("ambient", 0.2, 0.1, 12, 1),
    ),
    "hall": study(
        entry("surface", 0.97, 9, 8000, 40),
        entry("lightmap", 0.9, 1, 90000, 40),
        entry("path-tracing", 0.98, 800, 0, 1),
    ),
}


def test_methods_that_reach_the_goal_in_more_scenes_come_first():
    rows = summary.summarised(STUDIES)["ranking"]["0.95"]
    assert [(row["method"], row["reached"]) for row in rows] == [
        ("surface", 2), ("path-tracing", 2), ("lightmap", 1), ("ambient", 0),
    ]  # fmt: skip


def test_costs_are_geometric_means_over_the_scenes_that_are_reached():
    first, traced, lightmap, constant = summary.summarised(STUDIES)["ranking"]["0.95"]
    assert first["file_bytes"] == pytest.approx(4000)
    assert first["bake_seconds"] == pytest.approx(20)
    assert first["more_ms"] == pytest.approx(6)
    assert traced["file_bytes"] == 0
    assert lightmap["file_bytes"] == pytest.approx(90000)
    assert lightmap["scenes"]["hall"] is None
    assert constant["file_bytes"] is None


def test_the_page_names_every_method_and_scene_once_per_table(tmp_path):
    data = summary.write(STUDIES, tmp_path)
    assert json.loads((tmp_path / summary.DATA).read_text()) == data
    page = (tmp_path / summary.PAGE).read_text()
    assert page.count("<table>") == 1
    assert all(page.count(f"the {name}<") == 1 for name in METHODS)
    assert page.count('href="room/report.html"') == page.count('href="hall/report.html"') == 1
    assert page.count("not reached") == 3
    assert "2 of 2" in page


def test_the_command_gives_each_of_several_scenes_a_folder(tmp_path, monkeypatch, capsys):
    def made(options, folder, *_):
        (folder / "here").write_text(options.scene)
        return STUDIES[folder.name]

    monkeypatch.setattr(tradeoff, "_study", made)
    out = tmp_path / "out"
    arguments = ["tradeoff", "a/room.glb", "b/hall.glb", "-o", str(out), "--quiet", "--json"]
    assert main.run(arguments) == 0
    assert (out / "room" / "here").read_text() == "a/room.glb"
    assert (out / "hall" / "here").read_text() == "b/hall.glb"
    assert json.loads(capsys.readouterr().out) == json.loads((out / summary.DATA).read_text())


def test_scenes_of_the_same_name_are_refused(tmp_path, capsys):
    assert main.run(["tradeoff", "a/room.glb", "b/room.gltf", "-o", str(tmp_path / "out")]) == 1
    assert "SCENE: expected files with different names, got a/room.glb b/room.gltf" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
