"""Headless contexts."""

import subprocess
import sys

import pytest

from gsgi.runtime import context
from gsgi.runtime.context import create_context, renderer_string
from gsgi.runtime.errors import UnsupportedError

DRAW = """
import sys
from gsgi.runtime.context import create_context, renderer_string
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
