"""Headless contexts."""

import os
import platform
import subprocess
import sys
from types import SimpleNamespace

import glcontext
import pytest
from repository import SCENES

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gl import context
from gsgi.runtime.gl.context import create_context, renderer_string

DRAW = """
import sys
from gsgi.runtime.gl.context import create_context, renderer_string
ctx = create_context(sys.argv[1])
assert ctx.version_code >= 330, ctx.version_code
target = ctx.framebuffer(ctx.texture((4, 4), 4, dtype="f4"))
target.use()
target.clear(0.25, 2.0, 3.0, 1.0)
assert target.read(components=4, dtype="f4")[4:8] == b"\\x00\\x00\\x00\\x40"
print(renderer_string(ctx))
ctx.release()
"""


def test_each_backend_draws_floats(backends):
    if not backends:
        pytest.skip("no OpenGL 3.3 backend on this machine")
    for name in backends:
        child = subprocess.run([sys.executable, "-c", DRAW, name], capture_output=True, text=True)
        assert child.returncode == 0, child.stderr
        assert len(child.stdout.splitlines()) == 1


def test_the_context_of_the_systems_windows_draws_floats(display):
    child = subprocess.run([sys.executable, "-c", DRAW, "system"], env=display, capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    assert len(child.stdout.splitlines()) == 1


class Desktop:
    """Stands for the module of glcontext, and the context that it makes, of a system that is not here: its drawing is
    that of EGL."""

    def __init__(self, broken: str = ""):
        self.broken, self.asked = broken, []

    def create_context(self, **how):
        self.asked.append(how)
        if self.broken:
            raise Exception(self.broken)
        return glcontext.get_backend_by_name("egl")(**how)


DESKTOPS = {"win32": ("Windows", "wgl", "WGL"), "darwin": ("Darwin", "darwin", "CGL")}


@pytest.fixture(params=DESKTOPS)
def desktop(request, monkeypatch, gl):
    """(desktop, the name of what it draws by) on a machine that says it is a desktop of that system."""
    system, module, name = DESKTOPS[request.param]
    made = Desktop()
    monkeypatch.setattr(context.sys, "platform", request.param)
    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setitem(sys.modules, f"glcontext.{module}", made)
    yield made, name
    gl.__enter__()


def test_a_desktop_draws_by_its_own(desktop):
    (stand_in, name), lines = desktop, []
    with create_context("auto", say=lines.append) as made:
        texture = made.texture((1, 1), 4)
        made.framebuffer(texture).clear(1, 0, 1, 1)
        assert texture.read() == b"\xff\x00\xff\xff"
        assert lines == [f"OpenGL: {name}, {renderer_string(made)}"]
    assert [how["mode"] for how in stand_in.asked] == ["standalone"]


def test_a_desktop_without_opengl_says_what_helps_there(desktop):
    stand_in, name = desktop
    stand_in.broken = "cannot select a pixel format"
    with pytest.raises(UnsupportedError, match=r"\(system: cannot select a pixel format\); ") as caught:
        create_context()
    assert "Debian" not in str(caught.value)
    assert ("opengl32.dll" in str(caught.value)) == (name == "WGL")


def test_a_device_that_is_not_there_is_not_replaced_by_another(gl):
    with pytest.raises(UnsupportedError, match="egl: ") as caught:
        create_context("auto", device=99)
    assert "osmesa:" not in str(caught.value)
    gl.__enter__()


def test_renderer_string_names_driver_and_version(gl):
    assert gl.info["GL_RENDERER"] in renderer_string(gl)
    assert gl.info["GL_VERSION"] in renderer_string(gl)


def test_failure_is_one_line_that_says_what_to_install(monkeypatch):
    def refuse(**_):
        raise Exception("no display\nat all")

    monkeypatch.setattr(context.moderngl, "create_context", refuse)
    monkeypatch.setattr(context, "OSMesa", lambda: refuse())
    with pytest.raises(UnsupportedError) as caught:
        create_context("auto")
    text = str(caught.value)
    assert "\n" not in text
    for part in ("egl: no display at all", "osmesa: no display at all", "libegl1", "libosmesa6"):
        assert part in text


def test_what_was_chosen_is_said_with_what_failed_before(monkeypatch):
    def made(**source) -> SimpleNamespace:
        if source.get("backend") == "egl":
            raise Exception("no display\nat all")
        return SimpleNamespace(info={"GL_RENDERER": "llvmpipe (LLVM 15)", "GL_VERSION": "4.5 Mesa 22"})

    monkeypatch.setattr(context.moderngl, "create_context", made)
    monkeypatch.setattr(context, "OSMesa", object)
    lines = []
    create_context("auto", say=lines.append)
    create_context("osmesa", say=lines.append)
    osmesa = "OpenGL: OSMesa, llvmpipe (LLVM 15), 4.5 Mesa 22"
    assert lines == [f"{osmesa}; EGL failed: no display at all", osmesa]


@pytest.mark.parametrize("broken", [False, True])
def test_render_says_what_draws(tmp_path, backends, broken):
    """`broken`: EGL's loader finds no driver."""
    if backends != ("egl", "osmesa"):
        pytest.skip(f"needs EGL and OSMesa, got {backends}")
    scene = SCENES / "furnace.glb"
    command = [sys.executable, "-m", "gsgi.baker", "render", scene, "-o", tmp_path / "a.png", "--size", "16x16"]
    driver = {"__EGL_VENDOR_LIBRARY_FILENAMES": str(tmp_path / "none.json")} if broken else {}
    child = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | driver)
    (line,) = (line for line in child.stderr.splitlines() if line.startswith("OpenGL: "))
    assert line.split(", ")[0] == ("OpenGL: OSMesa" if broken else "OpenGL: EGL")
    assert ("; EGL failed: " in line) == broken
