"""`gsgi export --web`: the folder appears as a whole, and replaces nothing but a page of ours."""

import json
import os
import subprocess
import sys

import pytest
from gsgi_files import constant, example
from repository import SCENES

from gsgi.baker.cli.main import run
from gsgi.runtime.errors import FileError, UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.web.folder import check_folder, replacing_folder

ROOM = str(SCENES / "cornell.glb")


@pytest.fixture
def light(tmp_path):
    path = tmp_path / "room.gsgi"
    path.write_bytes(codec.encode(constant([0.5, 0.25, 0.125])))
    return str(path)


def test_the_command_writes_a_page_and_replaces_it(tmp_path, light, capfd):
    site = tmp_path / "a" / "site"
    assert run(["export", ROOM, "--gi", light, "--web", str(site), "-q"]) == 0
    assert capfd.readouterr().err.splitlines()[-1].startswith(f"wrote {site}: a page of 0.")
    description = json.loads((site / "scene.json").read_text())
    assert [camera["name"] for camera in description["cameras"]] == ["front", "corner"]
    (site / "scene.bin").write_bytes(b"old")
    assert run(["export", ROOM, "--gi", light, "--sun", "140,35", "--web", str(site), "-q"]) == 0
    assert len((site / "scene.bin").read_bytes()) > 3
    assert len(json.loads((site / "scene.json").read_text())["lights"]) == len(description["lights"]) + 1
    assert os.listdir(site.parent) == ["site"]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--web", "site"], 1, "--web DIR needs --gi FILE"),
        (["--web", "site", "--gi", "LIGHT", "-o", "a.npz"], 1, "leave out -o"),
        (["--probes", "1"], 1, "without --web needed is -o OUT"),
        (["--probes", "1", "-o", "a.npz", "--gi", "LIGHT"], 1, "leave out --gi"),
        (["--web", "site", "--gi", "none.gsgi"], 2, "none.gsgi: cannot read"),
        (["--web", "mine", "--gi", "LIGHT"], 1, "--web mine: exists, and is neither empty nor a page"),
        (["--web", "LIGHT/site", "--gi", "LIGHT"], 2, "LIGHT/site: cannot write"),
        (["--web", "site", "--gi", "over.gsgi"], 5, "over.gsgi: the bake has the `over` operator"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, light, monkeypatch, capfd, arguments, code, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    (tmp_path / "over.gsgi").write_bytes(codec.encode(example(3)))
    before = sorted(os.listdir())
    assert run(["export", ROOM, *(each.replace("LIGHT", light) for each in arguments), "-q"]) == code
    assert message.replace("LIGHT", light) in capfd.readouterr().err
    assert sorted(os.listdir()) == before
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"


def write(site, meanwhile=lambda: None) -> None:
    """Write a page of one file; call `meanwhile` before it is finished."""
    with replacing_folder(site) as new:
        (new / "scene.json").write_text('{"generator": "gsgi"}')
        meanwhile()
        (new / "scene.bin").write_bytes(bytes(1 << 20))


def interrupted():
    raise KeyboardInterrupt


def test_a_failure_leaves_the_old_folder_and_nothing_else(tmp_path):
    site = tmp_path / "site"
    write(site)
    with pytest.raises(KeyboardInterrupt):
        write(site, interrupted)
    assert sorted(os.listdir(site)) == ["scene.bin", "scene.json"]
    assert os.listdir(tmp_path) == ["site"]


def test_a_page_that_became_something_else_meanwhile_stays(tmp_path):
    site = tmp_path / "site"

    def meanwhile():
        site.mkdir()
        (site / "thesis.txt").write_text("years of work")

    with pytest.raises(UsageError, match="neither empty nor a page"):
        write(site, meanwhile)
    assert os.listdir(site) == ["thesis.txt"]
    assert os.listdir(tmp_path) == ["site"]


@pytest.mark.parametrize("content", ["", "[]", '{"generator": 1}', "{"])
def test_a_scene_description_of_others_is_no_page(tmp_path, content):
    (tmp_path / "scene.json").write_text(content)
    with pytest.raises(UsageError):
        check_folder(tmp_path)


def test_a_full_disk_is_an_error_that_names_the_folder(small_disk):
    with pytest.raises(FileError, match="site: cannot write"):
        write(small_disk / "site")
    assert os.listdir(small_disk) == []


KILLED = """
import os, sys
from pathlib import Path
from gsgi.runtime.web.folder import replacing_folder

rename, calls = Path.rename, []
def renamed(self, target):
    calls.append(self)
    if len(calls) == 2:
        os._exit(9)
    return rename(self, target)
Path.rename = renamed
with replacing_folder(sys.argv[1]) as new:
    (new / "scene.json").write_text('{"generator": "gsgi", "page": 2}')
"""


def test_a_page_that_was_set_aside_when_the_process_was_killed_comes_back(tmp_path):
    site = tmp_path / "site"
    write(site)
    assert subprocess.run([sys.executable, "-c", KILLED, str(site)]).returncode == 9
    assert not site.exists()
    with pytest.raises(KeyboardInterrupt):
        write(site, interrupted)
    assert sorted(os.listdir(site)) == ["scene.bin", "scene.json"]
    assert "page" not in json.loads((site / "scene.json").read_text())
    write(site)
    assert [name for name in os.listdir(tmp_path) if name.endswith(".old")] == []
