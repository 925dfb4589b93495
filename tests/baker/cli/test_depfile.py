"""Dependency files: what stands in them, that make and ninja read the names as they are, and when they are written."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import quick_gsgi
from gltf_files import png, quad_scene

from gsgi.baker.cli.depfile import depfile, nameable
from gsgi.runtime.errors import UsageError
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import write_image

NAMES = ["a b", "c#d", "e$f", "g:h", "C:x", "i%j", "k\\l", "m\\ n", "o[1]", "ü", "p, q", "~r", " s", "$(t)"]
PROGRAMS = {
    "make": ("Makefile", "out:\n\techo made > out\n-include out.d\n"),
    "ninja": ("build.ninja", "rule r\n  command = echo made > $out\n  depfile = out.d\nbuild out: r\n"),
}


def test_the_rule():
    text = depfile("a b.gsgi", map(Path, ["room.glb", "x/1.png", "x/1.png", "room.glb", "$(HOME)#1.png", "C:x.bin"]))
    assert text.decode().splitlines() == [
        "a\\ b.gsgi: \\",
        "  room.glb \\",
        "  x/1.png \\",
        "  C\\:x.bin",
        "x/1.png:",
        "C\\:x.bin:",
    ]


@pytest.mark.parametrize("name", ["a\nb", "a;b", "a|b", "a*b", "a?b", "a'b", 'a"b', "a=b", "a:", "a\\", "(a)", "a&b"])
def test_names_that_no_build_tool_takes(name):
    assert not nameable(name)
    assert depfile("out", [Path("room.glb"), Path(name)]) == b"out: \\\n  room.glb\n"
    with pytest.raises(UsageError, match="output"):
        depfile(name, [])


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("name", [name for name in NAMES if nameable(name)])
def test_build_tools_find_the_file_of_that_name(tmp_path, program, name):
    """What is named is seen to change; nothing else is missing."""
    if not shutil.which(program):
        pytest.skip(f"{program} is not installed")

    def make() -> bool:
        subprocess.run([program], cwd=tmp_path, capture_output=True, check=True)
        return (tmp_path / "out").read_text() == "made\n"

    build_file, text = PROGRAMS[program]
    (tmp_path / build_file).write_text(text)
    (tmp_path / "other").touch()
    (tmp_path / name).touch()
    make()
    (tmp_path / "out.d").write_bytes(depfile("out", [Path("other"), Path(name)]))
    make()  # ninja looks at the list that the command has written
    (tmp_path / "out").write_text("as before\n")
    assert not make()
    future = (tmp_path / "out").stat().st_mtime + 10
    os.utime(tmp_path / name, (future, future))
    assert make()


def write_room(folder: Path) -> Path:
    """A scene with a buffer, two images of which one is used, lights beside it, and their sky."""
    document, data = quad_scene()
    document["images"] = [{"uri": "tex/../tex/%61%20b.png"}, {"uri": "unused.png"}]
    document["buffers"][0]["uri"] = "room.bin"
    (folder / "tex").mkdir(parents=True)
    (folder / "tex" / "a b.png").write_bytes(png([[[255] * 4]]))
    (folder / "room.bin").write_bytes(data)
    (folder / "room.gltf").write_text(json.dumps(document))
    (folder / "room.lights.toml").write_text('env = "sky.exr"\n')
    write_image(folder / "sky.exr", np.ones((4, 8, 3), np.float32))
    return folder / "room.gltf"


READ = ["room.gltf", "room.bin", "tex/../tex/a b.png", "room.lights.toml", "sky.exr"]


def test_the_reader_names_its_files_as_the_scene_spells_them(tmp_path, monkeypatch):
    write_room(tmp_path / "assets")
    monkeypatch.chdir(tmp_path)
    scene = read_gltf("assets/room.gltf")
    assert [str(path) for path in scene.files] == [f"assets/{name}" for name in READ[:3]]


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A folder with a scene, and `gsgi bake` of it without tracing: options -> exit code."""
    write_room(tmp_path)
    monkeypatch.chdir(tmp_path)
    bake = "log", "bake", "room.gltf", "-o", "room.gsgi"
    return lambda *options: quick_gsgi.main(*bake, *options, put=monkeypatch.setattr)


def test_a_bake_lists_all_that_it_has_read(room):
    Path("path.json").write_text('{"cameras": [{"position": [0, 0, 1], "target": [0, 0, 0]}]}')
    assert room("--depfile", "room.d") == 0
    assert Path("room.d").read_bytes() == depfile("room.gsgi", map(Path, READ))
    assert room("--depfile", "room.d", "--env", "1,1,1", "--camera-path", "path.json") == 0
    assert Path("room.d").read_bytes() == depfile("room.gsgi", map(Path, [*READ[:-1], "path.json"]))


def test_only_if_changed(room):
    def age() -> int:
        os.utime("room.gsgi", (1e9, 1e9))
        return 10**18

    assert room("--if-changed") == 0
    before = age()
    assert room("--if-changed", "--depfile", "room.d") == 0
    assert Path("room.gsgi").stat().st_mtime_ns == before
    assert Path("room.d").exists()
    assert room() == 0
    assert Path("room.gsgi").stat().st_mtime_ns != before
    before = age()
    Path("tex/a b.png").write_bytes(png([[[0, 0, 0, 255]]]))
    assert room("--if-changed") == 0
    assert Path("room.gsgi").stat().st_mtime_ns != before


def test_a_failed_bake_touches_neither_file(room, capsys):
    assert room("--depfile", "room.d") == 0
    before = {name: Path(name).read_bytes() for name in ("room.gsgi", "room.d")}
    Path("room.bin").write_bytes(b"")
    assert room("--depfile", "room.d") == 3
    write_room(Path("again"))
    Path("dir.d").mkdir()
    assert room("--depfile", "dir.d") == 2
    assert {name: Path(name).read_bytes() for name in before} == before


@pytest.mark.parametrize("name", ["room.gsgi", "room.gltf", "room.bin", "tex/a b.png", "sky.exr"])
def test_the_list_overwrites_nothing_of_the_bake(room, capsys, name):
    before = Path(name).read_bytes() if Path(name).exists() else None
    assert room("--depfile", name) == 1
    assert "would overwrite" in capsys.readouterr().err
    assert (Path(name).read_bytes() if Path(name).exists() else None) == before


def test_a_file_that_cannot_be_named_is_said(room, capsys):
    Path("a;b.toml").write_text("sun = [0, 90]\n")
    assert room("--depfile", "room.d", "--lights", "a;b.toml") == 0
    assert "a;b.toml" in capsys.readouterr().err
    assert ";" not in Path("room.d").read_text()


def test_the_stand_in_is_a_program(room):
    command = [sys.executable, quick_gsgi.__file__, "log", "bake", "room.gltf", "-o", "a.gsgi", "--depfile", "a.d"]
    subprocess.run(command, check=True)
    assert room() == 0
    assert Path("a.gsgi").read_bytes() == Path("room.gsgi").read_bytes()
    assert Path("log").read_text() == "room\nroom\n"
