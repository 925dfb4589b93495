"""What the data of a study says: goals, domination, recommendations."""

import json

import pytest

from gsgi.baker.cli import main
from gsgi.baker.tradeoff.ranking import Wish, cheapest, compared, dominated, recommended
from gsgi.baker.tradeoff.report import DATA
from gsgi.baker.tradeoff.tables import SCHEMA


def entry(
    method: str, value: float, ssim: float, ms: float, size: int, seconds: float, scale: int = 1, paths: float = 1.0
) -> dict:
    return {
        "method": method, "value": value, "paths": paths, "scale": scale, "label": f"{value:g} Gaussians",
        "mean": {"ssim": ssim}, "frame_ms": 10 + ms, "more_ms": ms, "file_bytes": size, "bake_seconds": seconds,
        "command": f"gsgi bake room.glb -o out.gsgi --budget {value:g}",
    }  # fmt: skip


ENTRIES = [
    entry("surface", 100, 0.93, 1, 2000, 10),
    entry("surface", 100, 0.92, 0.5, 2000, 10, scale=2),
    entry("surface", 400, 0.97, 2, 8000, 20),
    entry("surface", 1600, 0.99, 4, 32000, 60),
    entry("lightmap", 8, 0.91, 0.2, 50000, 5),
    entry("lightmap", 16, 0.96, 0.2, 200000, 30),
]


def test_the_smallest_setting_that_is_enough_is_chosen_of_each_method():
    assert cheapest(ENTRIES, 0.9) == [
        ENTRIES[4],
        ENTRIES[1],
    ]  # the fastest frame first, the lowest resolution that does
    assert cheapest(ENTRIES, 0.95) == [ENTRIES[5], ENTRIES[2]]
    assert cheapest(ENTRIES, 0.98) == [ENTRIES[3]]
    assert cheapest(ENTRIES, 0.999) == []


def test_an_entry_is_dominated_if_another_costs_no_more_and_errs_less():
    assert dominated(ENTRIES, "frame_ms") == [True, True, False, False, True, False]
    assert dominated(ENTRIES, "file_bytes") == [False, True, False, False, True, True]


def test_what_costs_nothing_dominates_nothing_that_costs():
    free = [entry("path-tracing", 4, 0.95, 900, 0, 0), entry("none", 0, 0.1, 0, 0, 0)]
    assert dominated([*ENTRIES, *free], "file_bytes")[:6] == dominated(ENTRIES, "file_bytes")
    assert dominated([*ENTRIES, *free], "file_bytes")[6:] == [False, True]
    assert dominated([*ENTRIES, *free], "frame_ms")[6:] == [True, False]


def test_other_numbers_of_paths_count_for_the_seconds_of_a_bake_alone():
    entries = [*ENTRIES, entry("surface", 400, 0.98, 2, 7990, 15, paths=0.25)]
    assert compared(entries, "file_bytes") == list(range(len(ENTRIES)))
    assert cheapest(entries, 0.95) == cheapest(ENTRIES, 0.95)
    assert dominated(entries, "file_bytes")[: len(ENTRIES)] == dominated(ENTRIES, "file_bytes")
    assert dominated(entries, "bake_seconds") == [False, True, True, False, False, True, False]
    assert recommended(entries, Wish(ssim=0.96))[0] is ENTRIES[2]
    assert recommended(entries, Wish(ssim=0.96, seconds=15))[0] is entries[-1]


def test_the_most_accurate_within_limits_is_recommended():
    assert recommended(ENTRIES, Wish(ms=2.5, bytes=10_000))[0] is ENTRIES[2]
    assert recommended(ENTRIES, Wish(ms=0.7))[0] is ENTRIES[1]
    assert recommended(ENTRIES, Wish(seconds=1000))[0] is ENTRIES[3]


def test_the_smallest_that_is_accurate_enough_is_recommended():
    assert recommended(ENTRIES, Wish(ssim=0.95))[0] is ENTRIES[2]
    assert recommended(ENTRIES, Wish(ssim=0.92))[0] is ENTRIES[1]  # of two files of one size, the faster pass


def test_nothing_is_recommended_if_nothing_keeps_the_limits():
    found, reason = recommended(ENTRIES, Wish(ssim=0.98, bytes=10_000))
    assert found is None
    assert "none of 4 settings" in reason
    assert recommended(ENTRIES[4:], Wish(ms=1))[0] is None


@pytest.fixture
def folder(tmp_path):
    tmp_path = tmp_path / "study"
    tmp_path.mkdir()
    data = {"schema": SCHEMA, "ceiling": 0.995, "frame": {"width": 8, "height": 6}, "entries": ENTRIES}
    (tmp_path / DATA).write_text(json.dumps(data))
    return tmp_path


def test_the_command_prints_what_to_run(folder, capsys):
    assert main.run(["recommend", str(folder), "--max-bytes", "10k", "--max-ms", "2"]) == 0
    command, reason = capsys.readouterr().out.splitlines()
    assert command == "gsgi bake room.glb -o out.gsgi --budget 400"
    assert "SSIM of B 0.9700 (ceiling 0.9950), 8,000 bytes" in reason
    assert main.run(["recommend", str(folder), "--max-ms", "0.7"]) == 0
    assert "splat_scale=2" in capsys.readouterr().out
    assert main.run(["recommend", str(folder), "--max-ms", "0.7", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scale"] == 2


@pytest.mark.parametrize(
    ("arguments", "code", "line"),
    [
        ([], 1, "at least one of --min-ssim"),
        (["--max-bytes", "1"], 6, "none of 4 settings keeps all limits"),
    ],
)
def test_what_cannot_be_recommended_is_one_line(folder, capsys, arguments, code, line):
    assert main.run(["recommend", str(folder), *arguments]) == code
    assert line in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "code", "line"),
    [
        (None, 2, "cannot read"),
        ("{", 3, "expected JSON"),
        ('{"schema": 99}', 3, f"schema: expected {SCHEMA}, got 99"),
        ("[]", 3, "schema: expected"),
    ],
)
def test_a_folder_without_a_study_is_refused(tmp_path, capsys, content, code, line):
    if content is not None:
        (tmp_path / DATA).write_text(content)
    assert main.run(["recommend", str(tmp_path), "--max-ms", "1"]) == code
    error = capsys.readouterr().err
    assert str(tmp_path / DATA) in error
    assert line in error


def test_a_scene_and_a_study_of_several_are_told_what_to_give(folder, capsys):
    (folder.parent / "room.glb").touch()
    assert main.run(["recommend", str(folder.parent / "room.glb"), "--max-ms", "1"]) == 2
    assert "gsgi tradeoff" in capsys.readouterr().err
    assert main.run(["recommend", str(folder.parent), "--max-ms", "1"]) == 2
    assert f"expected one of {folder}" in capsys.readouterr().err


def test_an_unknown_method_is_refused_before_any_work(tmp_path, capsys):
    assert main.run(["tradeoff", "missing.glb", "-o", str(tmp_path / "out"), "--methods", "surface,lightmaps"]) == 1
    assert "got 'lightmaps'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
