"""samples/06_build_integration with make, ninja and CMake: what is baked again, and what is left alone."""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import quote

import pytest
from gltf_files import png, quad_scene
from repository import ROOT

SAMPLE = ROOT / "samples" / "06_build_integration"
WHITE, GREY = [[[255] * 4] * 2] * 2, [[[128, 128, 128, 255]] * 2] * 2


def write_scene(folder: Path, name: str, image: str, generator: str = "a test") -> None:
    """A square with its buffer and its image in files of their own."""
    document, data = quad_scene()
    document["asset"]["generator"] = generator
    document["images"] = [{"uri": quote(image)}]
    document["buffers"][0]["uri"] = f"{name}.bin"
    (folder / f"{name}.bin").write_bytes(data)
    (folder / f"{name}.gltf").write_text(json.dumps(document))


BUILD_NINJA = """
rule bake
  command = {gsgi} bake $in -o $out --depfile $out.d --if-changed --seed 1
  depfile = $out.d
  restat = 1
rule pack
  command = cat $in > $out
build hall.gsgi: bake ../my$ assets/hall.gltf
build room.gsgi: bake ../my$ assets/room.gltf
build game.tar: pack hall.gsgi room.gsgi
"""

PROGRAMS = {"make": ["make"], "ninja": ["ninja"], "cmake": ["cmake", "ninja"]}


class Project:
    """Two scenes, and a build of them: the sample's Makefile or CMakeLists.txt, or a few lines for ninja."""

    def __init__(self, folder: Path, tool: str):
        self.tool, self.out, self.log = tool, folder / "out", folder / "bakes.log"
        self.assets = folder / ("assets" if tool == "make" else "my assets")
        # What make cannot have in the names of scenes, nor CMake in any: a blank; # and $.
        self.wallpaper = "images/wall paper.png" if tool == "cmake" else "images/wall paper #1 $x:y.png"
        (self.assets / "images").mkdir(parents=True)
        for name, image in (("hall", self.wallpaper), ("room", "images/room.png")):
            (self.assets / image).write_bytes(png(WHITE))
            write_scene(self.assets, name, image)
        self.gsgi = folder / "gsgi"
        self.gsgi.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{ROOT}/tests/quick_gsgi.py" "{self.log}" "$@"\n')
        self.gsgi.chmod(0o755)
        if tool == "cmake":
            self._run("cmake", "-G", "Ninja", "-S", SAMPLE, "-B", self.out, "-D", f"SCENES={self.assets}",
                      "-D", f"GSGI={self.gsgi}", "-D", "FLAGS=--seed;1")  # fmt: skip
        elif tool == "ninja":
            self.out.mkdir()
            (self.out / "build.ninja").write_text(BUILD_NINJA.format(gsgi=self.gsgi))

    def build(self, fails: bool = False) -> tuple[list[str], bool]:
        """Which scenes were baked, and whether the game was packed again."""
        self.log.write_text("")
        before = self._packed()
        if self.tool == "make":
            arguments = f"GSGI={self.gsgi}", f"SCENES={self.assets}", f"OUT={self.out}", "FLAGS=--seed 1"
            self._run("make", "-C", SAMPLE, *arguments, fails=fails)
        else:
            self._run(*{"ninja": ["ninja", "-C"], "cmake": ["cmake", "--build"]}[self.tool], self.out, fails=fails)
        return sorted(self.log.read_text().split()), self._packed() != before

    def baked(self, name: str) -> Path:
        """The file that bakes of this scene write."""
        return self.out / ("baked" if self.tool == "make" else "") / f"{name}.gsgi"

    def depfile(self, name: str) -> Path:
        """The list of what the last good bake has read."""
        return Path(f"{self.baked(name)}.d")

    def edit(self, name: str, content: bytes) -> None:
        """Write an asset, at a later time than all that was built."""
        time.sleep(0.02)
        (self.assets / name).write_bytes(content)

    def _packed(self) -> int:
        package = self.out / "game.tar"
        return package.stat().st_mtime_ns if package.exists() else 0

    @staticmethod
    def _run(*command, fails: bool = False) -> None:
        run = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=120)
        assert (run.returncode != 0) == fails, run.stdout + run.stderr


@pytest.fixture(params=PROGRAMS)
def project(request, tmp_path) -> Project:
    """One for each tool. Skips where a program is missing."""
    for program in PROGRAMS[request.param]:
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed (Debian: make, ninja-build, cmake)")
    return Project(tmp_path, request.param)


def test_only_what_changed_is_baked(project):
    assert project.build() == (["hall", "room"], True)
    assert project.build() == ([], False)
    project.edit("images/other.png", png(WHITE))
    assert project.build() == ([], False)

    project.edit(project.wallpaper, png(GREY))
    assert project.build() == (["hall"], True)
    assert project.build() == ([], False)
    project.edit("room.bin", (project.assets / "room.bin").read_bytes())
    assert project.build() == (["room"], False)
    assert project.build() == ([], False)


@pytest.mark.parametrize("project", ["make", "cmake"], indirect=True)
def test_lights_that_come_and_go(project):
    project.build()
    project.edit("room.lights.toml", b"sun = [140, 35]\n")
    assert project.build()[0] == ["room"]
    project.edit("room.lights.toml", b"sun = [140, 40]\n")
    assert project.build()[0] == ["room"]
    assert project.build() == ([], False)
    # Gone: the list names a file that is not there.
    (project.assets / "room.lights.toml").unlink()
    assert project.build()[0] == ["room"]
    assert project.build() == ([], False)


def test_what_comes_out_the_same_has_nothing_made_again(project):
    project.build()
    before = project.baked("room").read_bytes()
    write_scene(project.assets, "room", "images/room.png", "another exporter")
    baked, packed = project.build()
    assert baked == ["room"]
    assert project.baked("room").read_bytes() == before
    assert not packed
    assert project.build() == ([], False)


def test_a_failed_bake_leaves_the_old_file_and_is_tried_again(project):
    project.build()
    kept = [path for name in ("hall", "room") for path in (project.baked(name), project.depfile(name))]
    before = {path: path.read_bytes() for path in kept if path.exists()}
    assert len(before) == 4
    project.edit("images/room.png", b"no picture")
    assert project.build(fails=True) == ([], False)
    assert project.build(fails=True) == ([], False)
    assert {path: path.read_bytes() for path in before} == before
    project.edit("images/room.png", png(GREY))
    assert project.build() == (["room"], True)
    assert project.depfile("room").read_bytes() == before[project.depfile("room")]


def test_the_sample_is_short():
    for name in ("Makefile", "CMakeLists.txt"):
        assert len((SAMPLE / name).read_text(encoding="utf-8").splitlines()) < 60
