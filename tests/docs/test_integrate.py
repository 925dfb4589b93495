"""The Python of docs/integrate.md, run as it stands there. tests/samples run its C, tests/runtime/js its JavaScript."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import constant
from host import CAMERA, SIZE, Host, bake, pixels, projection, texture
from pyrender_scenes import solids
from repository import ROOT, SCENES
from surface_cases import grouped

import gsgi
from gsgi.runtime.file import codec

PAGE = (ROOT / "docs" / "integrate.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def block(word: str) -> str:
    """The one block of Python with this word."""
    (found,) = (each for each in BLOCKS if word in each)
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working directory, with room.glb and room.gsgi."""
    shutil.copy(SCENES / "cornell.glb", tmp_path / "room.glb")
    (tmp_path / "room.gsgi").write_bytes(codec.encode(constant([0.5, 0.25, 0.125])))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_is_run_here():
    words = "DeferredRenderer", "light.draw", "light.check", "light.weights", "IndirectLookup"
    words += "runtime.pyrender", "runtime.panda3d"
    assert sorted(map(block, words)) == sorted(BLOCKS)


def test_a_scene_is_drawn(folder, current_again):
    names = {}
    exec(block("DeferredRenderer").replace("1280, 720", "64, 48"), names)
    assert names["frame"].shape == (48, 64, 3)
    assert names["frame"].mean() > 0.05


def test_a_host_of_moderngl_gets_the_light(gl, folder):
    (folder / "room.gsgi").write_bytes(codec.encode(bake()))
    encoding = gsgi.Encoding(depth="window", normal="unsigned")
    depth, normals = Host(gl).textures(gl, encoding)
    albedo, radiance = texture(gl, np.full((*SIZE[::-1], 4), 0.5)), texture(gl, np.zeros((*SIZE[::-1], 4)))
    names = {
        "gsgi": gsgi, "ctx": gl, "depth": depth, "normals": normals, "view_from_world": CAMERA.view_from_world,
        "clip_from_view": projection(), "framebuffer": gl.framebuffer(radiance), "albedo": albedo,
    }  # fmt: skip
    exec(block("light.draw"), names)
    np.testing.assert_allclose(pixels(radiance)[..., :3], 0.5 * pixels(names["light"].indirect)[..., :3], atol=1e-3)
    assert pixels(radiance).mean() > 0.05
    names["print"] = pytest.fail  # nothing is wrong with this host
    exec(block("light.check"), names)
    names["light"].release()


def test_lights_change(gl):
    base, lamps, day = grouped(bake()).groups
    made = replace(bake(), groups=(base, lamps, replace(day, name="day")))
    names = {"light": gsgi.IndirectLight(gl, made)}
    exec(block("light.weights"), names)
    assert dict(names["light"].weights) == {"base": (1, 1, 1), "lamps": (0.2, 0.2, 0.2), "day": (1, 0.9, 0.8)}
    names["light"].release()


def test_a_forward_renderer_gets_the_light(gl, folder):
    (statement,) = re.findall(r"^```glsl\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    names = {
        "gsgi": gsgi, "ctx": gl,
        "VERTEX": "#version 330\nvoid main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0,"
                  " gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }",
        "FRAGMENT": "out vec4 color; void main() { vec3 radiance = vec3(1.0), albedo = vec3(0.5), position = vec3(0.1),"
                    " normal = vec3(0.0, 1.0, 0.0);" + statement + "color = vec4(radiance, 1.0); }",
    }  # fmt: skip
    exec(block("IndirectLookup"), names)
    target = gl.framebuffer(gl.texture((1, 1), 4, dtype="f4"))
    target.use()
    gl.enable_only(gl.NOTHING)
    gl.vertex_array(names["program"], []).render(vertices=3)
    np.testing.assert_allclose(np.frombuffer(target.read(dtype="f4"), "f4"), [1.25, 1.125, 1.0625], rtol=1e-3)


def test_a_program_with_pyrender_gets_the_light(pyrender, current_again, folder):
    names = {"scene": solids()}
    exec(block("runtime.pyrender"), names)
    assert names["color"].shape == (480, 640, 3)
    assert (names["depth"] > 0).any()


def test_a_program_with_panda3d_gets_the_light(folder):
    """In a process of its own, which has one frame drawn with the light, and one after."""
    pytest.importorskip("gltf", reason="the extra `panda3d` is not installed")
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from types import SimpleNamespace\n"
        "from panda3d.core import load_prc_file_data\n"
        "import panda3d_frames\n"
        "load_prc_file_data('', 'load-display p3headlessgl')\n"
        "host = panda3d_frames.Host(panda3d_frames.output((1, 1), 8))\n"
        "base, room, before = SimpleNamespace(cam=host.camera), host.room, host.draw()\n"
        f"{block('runtime.panda3d')}"
        "lit = host.draw() - before\n"
        "assert lit[30:50, 30:60].min(axis=(0, 1)).min() > 0.01 and lit.max() < 0.6, lit\n"
        "light.remove()\n"
        "assert (host.draw() == before).all()\n"
    )
    run = subprocess.run([sys.executable, "-c", code, ROOT / "tests"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_the_table_says_what_a_light_takes(gl):
    """Bytes on the GPU of the passes and of the look-up, by the page's formulas."""
    made = bake()
    passes = gsgi.IndirectLight(gl, made, splat_scale=2)
    passes.draw(*Host(gl).textures(gl, passes.encoding), CAMERA.view_from_world, projection())
    targets = passes._splats.targets
    width, height = SIZE
    whole = sum(
        each.width * each.height * each.components * (2 if each.dtype == "f2" else 4)
        for each in (targets.indirect, targets.position, targets.plane, targets.filled)
    )
    depth = 4 * width * height
    assert whole + depth == 12 * width * height + 48 * (width // 2) * (height // 2)
    assert "12 per pixel and 48 per reading" in PAGE
    passes.release()
