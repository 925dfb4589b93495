"""Shader loader: includes, defines, messages."""

import numpy as np
import pytest

from gsgi.runtime.constants import GLSL_FOLDER
from gsgi.runtime.gl import shader


def test_every_library_is_in_the_readme():
    readme = (GLSL_FOLDER / "README.md").read_text(encoding="utf-8")
    for path in GLSL_FOLDER.rglob("*.glsl"):
        name = path.relative_to(GLSL_FOLDER)
        assert f"`{name}`" in readme, name


def test_libraries_have_no_globals():
    for path in set(GLSL_FOLDER.rglob("*.glsl")) - {GLSL_FOLDER / "surface" / "gsgi_indirect.glsl"}:
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not line.startswith(("uniform", "in ", "out ", "flat ", "layout", "#version")), (path.name, line)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(shader, "GLSL_FOLDER", tmp_path)
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "fullscreen.vert").write_text("void main() { gl_Position = vec4(0.0); }\n")
    (tmp_path / "low.glsl").write_text("float low() { return float(DEGREE); }\n")
    (tmp_path / "high.glsl").write_text('#include "low.glsl"\nfloat high() { return low(); }\n')
    return tmp_path


def test_includes_are_expanded_once_and_defines_come_first(folder):
    (folder / "pass.frag").write_text('#include "low.glsl"\n#include "high.glsl"\nvoid main() {}\n')
    files = []
    text = shader.source("pass.frag", {"DEGREE": 2, "MASK": True}, files)
    assert files == ["pass.frag", "low.glsl", "high.glsl"]
    assert text.startswith("#version 330\n#define DEGREE 2\n#define MASK 1\n")
    assert text.count("float low()") == 1
    assert "#line 1 1\n" in text
    assert "#line 2 0\n" in text


def test_an_error_names_file_and_line(gl, folder):
    (folder / "high.glsl").write_text('#include "low.glsl"\n\nfloat high() { return wrong; }\n')
    (folder / "pass.frag").write_text('#include "high.glsl"\nout vec4 o;\nvoid main() { o = vec4(high()); }\n')
    with pytest.raises(RuntimeError, match=r"high\.glsl:3 ") as caught:
        shader.program(gl, "pass", DEGREE=0)
    assert "pass with {'DEGREE': 0}" in str(caught.value)
    assert "wrong" in str(caught.value)


def test_uniforms_arrive_as_numpy_prints_them(gl, folder):
    (folder / "pass.frag").write_text(
        "uniform mat4 m[2];\nuniform vec2 v;\nuniform float s;\nout vec4 o;\n"
        "void main() { o = m[1] * vec4(v, 0.0, s); }\n"
    )
    (folder / "lib" / "fullscreen.vert").write_text(
        "void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }\n"
    )
    program = shader.program(gl, "pass")
    matrices = np.arange(32.0).reshape(2, 4, 4)
    shader.set_uniforms(program, m=matrices, v=(1, 2), s=3.0, absent=4.0)
    target = gl.framebuffer(gl.texture((1, 1), 4, dtype="f4"))
    target.use()
    gl.enable_only(gl.NOTHING)
    gl.vertex_array(program, []).render(vertices=3)
    drawn = np.frombuffer(target.read(components=4, dtype="f4"), "f4")
    assert np.array_equal(drawn, matrices[1] @ [1, 2, 0, 3])
