"""Shader loader: includes, defines, messages; every permutation under both headers."""

import itertools

import numpy as np
import pytest

from gsgi.runtime import shader
from gsgi.runtime.constants import GLSL_FOLDER

BOOLS = (0, 1)
HOST = dict.fromkeys(
    ("DEPTH_WINDOW", "DEPTH_REVERSED", "NORMAL_OCTAHEDRAL", "NORMAL_UNSIGNED", "NORMAL_VIEW_SPACE"), BOOLS
)
PERMUTATIONS = {
    "gbuffer": {
        "BASE_TEXTURE": BOOLS,
        "METALLIC_TEXTURE": BOOLS,
        "NORMAL_TEXTURE": BOOLS,
        "EMISSION_TEXTURE": BOOLS,
        "VERTEX_COLOR": BOOLS,
        "ALPHA_MASK": BOOLS,
        "UNLIT": BOOLS,
        "INTERPOLATED": BOOLS,
    },
    "shadow": {"BASE_TEXTURE": BOOLS, "VERTEX_COLOR": BOOLS, "ALPHA_MASK": BOOLS},
    "background": {},
    "primary": {"SPOT": BOOLS, "DIRECTIONAL": BOOLS, "FACES": (1, 6)},
    "splat": {"SH_DEGREE": (0, 1, 2, 3)},
    "surface_points": {"SPLAT_SCALE": (1, 2, 4), "BOX": BOOLS, **HOST},
    "surface": {"SH_DEGREE": (0, 1, 2), "NORMAL_POWER": (0, 1, 4)},
    "surface_gap": {},
    "resolve": {"SPLAT_SCALE": (1, 2, 4), "COARSE": BOOLS, **HOST},
    "add_light": {"ALBEDO_SRGB": BOOLS},
    "forward": {
        "NORMAL": BOOLS,
        "VERTEX_COLOR": BOOLS,
        "TEXTURES": BOOLS,
        "NORMAL_TEXTURE": BOOLS,
        "LIT": BOOLS,
        "LIGHTS": (0, 3),
        "SHADOWS": BOOLS,
        "INDIRECT": BOOLS,
    },
    "silhouette": {},
    "visible": {"NORMAL": BOOLS},
    "composite": {},
    "display": {"SURFACES_ONLY": BOOLS},
    "ellipsoids": {"SH_DEGREE": (0, 1, 2, 3), "NORMAL_COLOR": BOOLS},
    "overlay": {},
}


def happens(name: str, defines: dict[str, int]) -> bool:
    """Whether a scene can call for this permutation."""
    if name == "gbuffer" and defines["NORMAL_TEXTURE"] and not defines["INTERPOLATED"]:
        return False
    if name == "gbuffer" and defines["UNLIT"]:
        return not (defines["METALLIC_TEXTURE"] or defines["NORMAL_TEXTURE"] or defines["EMISSION_TEXTURE"])
    if "DEPTH_WINDOW" in defines:
        return not any(defines[a] and defines[b] for a, b in (tuple(HOST)[:2], tuple(HOST)[2:4]))
    if name == "forward":
        lit = defines["NORMAL"] or defines["LIGHTS"] or defines["INDIRECT"]
        mapped = (defines["TEXTURES"] and defines["NORMAL"]) or not defines["NORMAL_TEXTURE"]
        return (defines["LIT"] or not lit) and mapped and (defines["LIGHTS"] or not defines["SHADOWS"])
    if name == "shadow" and not defines["ALPHA_MASK"]:
        return not any(defines.values())
    return not (name == "primary" and defines["SPOT"] and defines["DIRECTIONAL"])


PRODUCT = [
    (name, dict(zip(table, values, strict=True)))
    for name, table in PERMUTATIONS.items()
    for values in itertools.product(*table.values())
]
CASES = [(name, defines) for name, defines in PRODUCT if happens(name, defines)]


@pytest.mark.parametrize("header", [shader.CORE, shader.ES], ids=["330", "300es"])
@pytest.mark.parametrize(
    ("name", "defines"), CASES, ids=lambda v: v if isinstance(v, str) else "-".join(map(str, v.values()))
)
def test_every_program_compiles(gl, name, defines, header):
    shader.program(gl, name, header, **defines).release()


def test_every_shader_is_a_listed_pass_and_in_the_readme():
    readme = (GLSL_FOLDER / "README.md").read_text(encoding="utf-8")
    for path in GLSL_FOLDER.glob("*.*"):
        if path.suffix == ".glsl":
            assert f"`{path.name}`" in readme, path.name
        if path.suffix == ".frag":
            assert path.stem in PERMUTATIONS
            assert f"`{path.stem}`" in readme, path.name


def test_libraries_have_no_globals():
    for path in GLSL_FOLDER.glob("*.glsl"):
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not line.startswith(("uniform", "in ", "out ", "flat ", "layout", "#version")), (path.name, line)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(shader, "GLSL_FOLDER", tmp_path)
    (tmp_path / "fullscreen.vert").write_text("void main() { gl_Position = vec4(0.0); }\n")
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
    (folder / "fullscreen.vert").write_text(
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
