"""Commands that read a manifest, and what they say of one that lies."""

import json
from pathlib import Path

import gsgi_files
import numpy as np
import pytest
import worlds
from PIL import Image
from repository import SCENES

from gsgi.baker.cli.main import run
from gsgi.runtime.world.manifest import read_manifest

FURNACE = str(SCENES / "furnace.glb")
BOXES = worlds.cells(2, 1, 1) - [1.0, 1.0, 1.0]


@pytest.fixture
def path(tmp_path) -> Path:
    return worlds.write(tmp_path, [gsgi_files.constant((light,) * 3) for light in (0.5, 1.0)], BOXES)


def test_inspect_tells_what_a_world_holds(path, capsys):
    assert run(["inspect", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["sectors"], facts["gaussians"], facts["coarse_gaussians"]) == (2, 2, 2)
    assert facts["bytes"] == sum(sector.bytes for sector in read_manifest(path).sectors)
    assert facts["bounds"] == [[-1, -1, -1], [3, 1, 1]]


def test_render_draws_with_the_light_of_a_world(path, tmp_path):
    picture = tmp_path / "b.png"
    flags = ["--eye", "0,0,0.5", "--target", "0,0,-1", "--size", "32x32", "--layer", "indirect", "--exposure", "1"]
    assert run(["render", FURNACE, "--gi", str(path), "-o", str(picture), *flags, "--quiet"]) == 0
    assert np.asarray(Image.open(picture)).min() > 60


LIES = {
    "a missing file": (2, "sectors[1].file:", lambda path, file: file.unlink()),
    "another hash": (3, "sha256: expected", lambda path, file: file.write_bytes(file.read_bytes()[:-1] + b"\7")),
    "another version": (3, "version: expected 1, got 9", lambda path, file: edit(path, '"version": 1', '"version": 9')),
    "no JSON": (3, "expected JSON", lambda path, file: path.write_text("{")),
    "no manifest": (2, "cannot read", lambda path, file: path.unlink()),
}


def edit(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize("lie", LIES)
def test_a_lie_is_one_line_and_an_exit_code(path, lie, capsys):
    code, message, change = LIES[lie]
    change(path, path.parent / read_manifest(path).sectors[1].file)
    assert run(["inspect", str(path)]) == code
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_page_and_weights_need_a_single_file(path, tmp_path, capsys):
    assert run(["export", FURNACE, "--gi", str(path), "--web", str(tmp_path / "site")]) == 5
    assert "a page shows one .gsgi file, and no world" in capsys.readouterr().err
    weigh = ["--weight", "lamps=1", "-o", str(tmp_path / "x.png")]
    assert run(["render", FURNACE, "--gi", str(path), *weigh]) == 1
    assert "it was baked without groups" in capsys.readouterr().err
