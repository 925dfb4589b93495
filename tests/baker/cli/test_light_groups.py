"""Light groups on the command line: baked, shown, weighed, and refused in one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_flags import flags
from repository import SCENES
from small_tasks import place_quickly, sample_little

from gsgi.baker import estimate
from gsgi.baker.cli import main
from gsgi.runtime.file.reader import read_bake
from gsgi.runtime.image import read_image
from gsgi.runtime.light_groups import group_names

CORNELL = str(SCENES / "cornell.glb")
TINY = flags(budget=64, views=2, view_size=24, samples=64, bounces=2, iterations=16)
QUIET = ["--no-evaluate", "--quiet"]
LIGHT = ["--env", "0.05,0.1,0.2", "--sun", "200,40", "--group", "lamp=ceiling*"]


def refused(capsys, code: int, *arguments: str | Path) -> str:
    """Run; check the exit code and that stderr is one line; return that line."""
    assert main.run(list(map(str, arguments))) == code
    line = capsys.readouterr().err
    assert line.count("\n") == 1, line
    return line


@pytest.fixture(scope="module")
def baked(tmp_path_factory) -> Path:
    """The file of a bake in three groups: the lamp, the sun, and the sky as all the rest."""
    folder = tmp_path_factory.mktemp("groups")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GSGI_CACHE", str(folder / "cache"))
        place_quickly(patch.setattr)
        sample_little(patch.setattr)
        arguments = ["bake", CORNELL, "-o", str(folder / "c.gsgi"), *TINY, *QUIET, *LIGHT, "--group", "day=sun"]
        assert main.run(arguments) == 0
        first = (folder / "c.gsgi").read_bytes()
        before = {path.name for path in (folder / "cache").iterdir()}
        assert main.run(arguments) == 0
        assert (folder / "c.gsgi").read_bytes() == first
        assert {path.name for path in (folder / "cache").iterdir()} == before  # nothing was traced or solved again
    return folder / "c.gsgi"


def test_a_bake_holds_its_groups(baked, capsys):
    read = read_bake(baked)
    assert group_names(read) == ("base", "lamp", "day")
    assert [group.patterns for group in read.groups] == [(), ("ceiling*",), ("sun",)]
    assert main.run(["inspect", str(baked)]) == 0
    assert "light groups     base, lamp, day" in capsys.readouterr().out


def test_each_light_can_be_a_group_and_toml_says_the_same(baked, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("GSGI_CACHE", str(baked.parent / "cache"))  # has the views: groups do not change the light
    monkeypatch.setattr(estimate, "estimate", lambda plan: dict.fromkeys(plan.groups, 1.0))
    toml = tmp_path / "two.lights.toml"
    toml.write_text('env = [0.05, 0.1, 0.2]\nsun = [200, 40]\ngroup_each = true\n[groups]\nlamp = ["ceiling*"]\n')
    rows = []
    for light in ([*LIGHT, "--group-each"], ["--lights", str(toml)]):
        assert main.run(["plan", CORNELL, *light, "--json", *TINY]) == 0
        rows.append({row["what"]: row for row in json.loads(capsys.readouterr().out)})
    assert rows[0]["light groups"] == rows[1]["light groups"]
    assert rows[0]["light groups"]["decision"] == "3"
    assert rows[0]["light groups"]["why"].startswith("lamp, sun, environment: ")
    assert main.run(["plan", CORNELL, *LIGHT[:4], "--json", *TINY]) == 0
    assert "light group" not in capsys.readouterr().out


def test_frames_are_drawn_under_weights(baked, tmp_path, gl):
    def frame(name: str, *flags: str) -> np.ndarray:
        path = tmp_path / f"{name}.exr"
        light = [*LIGHT[:4], "--size", "48x32", "--quiet"]
        assert main.run(["render", CORNELL, "--gi", str(baked), "-o", str(path), *light, *flags]) == 0
        return read_image(path)

    off = [flag for name in ("base", "lamp", "day") for flag in ("--weight", f"{name}=0")]
    whole, dark, lamp = frame("whole"), frame("dark", *off), frame("lamp", *off, "--weight", "lamp=1")
    assert not dark.any()
    assert 0.05 < lamp.mean() / whole.mean() < 0.95
    red = frame("red", *off, "--weight", "lamp=2,0,0")
    np.testing.assert_allclose(red[..., 0], 2 * lamp[..., 0], rtol=0.01, atol=1e-4)
    assert not red[..., 1:].any()


@pytest.mark.parametrize(
    ("code", "flags", "message"),
    [
        (3, ["lamp=bulb"], "group 'lamp': expected a pattern that matches a light ('ceiling spot'), got 'bulb'"),
        (3, ["base=*"], "group 'base': expected another name"),
        (3, ["a=*", "b=ceiling spot"], "spot light 'ceiling spot': expected one group, got 'a', 'b'"),
        (1, ["lamp"], "argument --group: expected NAME=PATTERN, such as lamps=lamp*, got 'lamp'"),
        (1, ["=*"], "argument --group: expected NAME=PATTERN"),
    ],
)
def test_groups_that_cannot_be_are_refused(capsys, tmp_path, code, flags, message):
    groups = [part for flag in flags for part in ("--group", flag)]
    arguments = ["bake", CORNELL, "-o", str(tmp_path / "x.gsgi"), *groups, "--quiet"]
    if code == 3:
        assert f"{CORNELL}: {message}" in refused(capsys, code, *arguments)
        return
    with pytest.raises(SystemExit) as ended:
        main.run(arguments)
    assert ended.value.code == code
    assert message in capsys.readouterr().err


def test_groups_in_toml_that_cannot_be_are_refused(capsys, tmp_path):
    toml = tmp_path / "x.lights.toml"
    for text, message in (
        ('groups = "lamp"', "x.lights.toml: groups: expected a table of lists of patterns, got 'lamp'"),
        ('[groups]\nlamp = "spot"', "x.lights.toml: groups: lamp: expected a list of patterns, got 'spot'"),
        ("group_each = 1", "x.lights.toml: group_each: expected true or false, got 1"),
        ('[groups]\na = ["*"]\na = ["*"]', "x.lights.toml: expected TOML, got an error"),
    ):
        toml.write_text(text)
        assert message in refused(capsys, 3, "bake", CORNELL, "-o", tmp_path / "x.gsgi", "--lights", toml, "--quiet")


def test_only_the_surface_operator_has_groups(capsys, tmp_path):
    line = refused(capsys, 1, "bake", CORNELL, "-o", tmp_path / "x.gsgi", "--operator", "over", "--group", "a=*", "-q")
    assert "light groups: expected the operator surface, got over" in line


def test_weights_that_cannot_be_are_refused(baked, capsys, tmp_path):
    render = ["render", CORNELL, *LIGHT[:4], "-o", tmp_path / "x.png", "--quiet"]
    assert "--weight needs baked light: --gi FILE" in refused(capsys, 1, *render, "--weight", "lamp=1")
    line = refused(capsys, 1, *render, "--gi", baked, "--weight", "lamps=1")
    assert f"{baked}: weights: the bake has no light group 'lamps': it has 'base', 'lamp', 'day'" in line
    assert "weights: 'lamp': expected" in refused(capsys, 1, *render, "--gi", baked, "--weight", "lamp=-1")
    for flag in ("lamp", "lamp=", "=1", "lamp=1,2"):
        with pytest.raises(SystemExit) as ended:
            main.run([*map(str, render), "--weight", flag])
        assert ended.value.code == 1
        assert "argument --weight: expected NAME=X or NAME=R,G,B" in capsys.readouterr().err
