"""The table of defines: it matches shaders and documentation, and all that it can come to compiles."""

import itertools
import re

import numpy as np
import oracle
import pytest

from gsgi.runtime.constants import GLSL_FOLDER
from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend
from gsgi.runtime.gl import host_textures, shader
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.permutations import PASSES, Primitive, Reading, Triangles, defines, sampled
from gsgi.runtime.gl.surface_light import SCALES
from gsgi.runtime.pyrender.materials import SLOTS
from gsgi.runtime.scene import Light, Material, TextureSlot

BOTH = (False, True)
README = (GLSL_FOLDER / "README.md").read_text(encoding="utf-8")


def triangles() -> list[Triangles]:
    slots = (None, TextureSlot(0))
    materials = [
        Material("", (1, 1, 1, 1), base, 0.0, metal, normal, 1.0, (1, 1, 1), emission, cutoff, unlit=unlit)
        for base, metal, normal, emission in itertools.product(slots, repeat=4)
        for cutoff, unlit in itertools.product((None, 0.5), BOTH)
    ]
    every = itertools.product(materials, BOTH, BOTH)
    solid = [Triangles(m, colored, bent) for m, colored, bent in every if bent or "normal" not in sampled(m)]
    some = materials[:: len(materials) // 8]
    return solid + [Triangles(m, True, bent=True, peeled=True, instanced=many) for m in some for many in BOTH]


def lights() -> list[Light]:
    kinds = itertools.product(("point", "spot", "directional"), (0.1, 0.8))
    return [Light(kind, np.ones(3), np.zeros(3), np.eye(3)[0], cos_outer=outer) for kind, outer in kinds]


def encodings() -> list[Encoding]:
    tables = host_textures.DEPTHS, host_textures.NORMALS, host_textures.SPACES, host_textures.ALBEDOS
    return [Encoding(*choice) for choice in itertools.product(*tables)]


def primitives() -> list[Primitive]:
    """Slots show only where there are texture coordinates, normal maps only on normals; what is flat is not lit."""
    shown = [(), ("base",), ("surface/gaussians",), ("base", "normal"), tuple(SLOTS)]
    light = [{}]
    for lights, shadows, indirect in itertools.product((0, 1, 3), BOTH, BOTH):
        if lights or not shadows:
            light.append({"lit": True, "lights": lights, "shadows": shadows, "indirect": indirect})
    light += [{"lit": True, "lights": 1, "lookup": counts} for counts in ((1, 9, 0), (4, 4, 3))]
    looks = [(slots, normals) for slots in shown for normals in BOTH if normals or "normal" not in slots]
    return [Primitive(*look, colored, **lit) for look, colored, lit in itertools.product(looks, BOTH, light)]


def of_degree(*degrees: int) -> list:
    return [oracle.random_gaussians(1, degree, seed=0) for degree in degrees]


READINGS = [Reading(*each) for each in itertools.product(SCALES, encodings(), BOTH)]
READINGS += [Reading(2, encoding, True, relief=True) for encoding in encodings()]
READINGS += [Reading(scale, Encoding(), False, sectors=True) for scale in (1, 2)]
SUBJECTS = {
    "frame/gbuffer": triangles(),
    "frame/background": BOTH,
    "frame/shadow": triangles(),
    "frame/primary": lights(),
    "over/splat": of_degree(0, 1, 2, 3),
    "surface/points": READINGS,
    "surface/read": [
        (Reading(scale, Encoding(), False, relief, sectors), counts)
        for scale, relief, sectors in itertools.product(SCALES, BOTH, BOTH)
        for counts in ((1, 9, 0), (4, 1, 3), (9, 4, 0))
    ],
    "surface/smooth": READINGS,
    "surface/resolve": READINGS,
    "surface/add_light": encodings(),
    "frame/blend": [None, (1, 9, 0), (4, 1, 3)],
    "frame/display": BOTH,
    "viewer/ellipsoids": [Bake(g, blend) for g in of_degree(0, 1, 2, 3) for blend in (OverBlend(0.1), SurfaceBlend())],
    "panda3d/light": [(1, 9, 0), (4, 1, 3), (9, 4, 0)],
    "tradeoff/lightmap": triangles(),
    "tradeoff/probes": BOTH,
    "tradeoff/vertex_light": triangles(),
    "pyrender/forward": primitives(),
    "pyrender/visible": [look._replace(relief=relief) for look in primitives() for relief in BOTH],
}
CASES = sorted({(name, *defines(name, subject).items()) for name in PASSES for subject in SUBJECTS.get(name, [None])})


def id_of(case: tuple) -> str:
    return "-".join([case[0], *(str(value) for _, value in case[1:])])


@pytest.mark.parametrize("header", [shader.CORE, shader.ES], ids=["330", "300es"])
@pytest.mark.parametrize("case", CASES, ids=id_of)
def test_every_permutation_compiles(gl, case, header):
    shader.program(gl, case[0], header, **dict(case[1:])).release()


def test_every_define_is_on_and_off_somewhere():
    values = {}
    for name, *found in CASES:
        for define, value in found:
            values.setdefault((name, define), set()).add(value)
    assert all(len(found) > 1 for found in values.values()), values
    assert values["frame/primary", "FACES"] == {1, 6}
    assert {define for _, define in values} == {define for rules in PASSES.values() for define in rules}


def test_every_shader_is_a_pass_of_the_table():
    files = (path for path in GLSL_FOLDER.rglob("*") if path.suffix in (".vert", ".frag"))
    stages = {str(path.relative_to(GLSL_FOLDER).with_suffix("")) for path in files} - {"lib/fullscreen"}
    assert stages == set(PASSES)


@pytest.mark.parametrize("name", PASSES)
def test_the_table_has_the_defines_that_a_pass_asks_for(name):
    vertex = f"{name}.vert" if (GLSL_FOLDER / f"{name}.vert").exists() else "lib/fullscreen.vert"
    text = "".join(shader.source(file, {}, []) for file in (vertex, f"{name}.frag"))
    text = re.sub(r"//.*", "", text)
    asked = {
        word
        for line in re.findall(r"^ *#(?:el)?if(?:n?def)?\b(.*)", text, re.M)
        for word in re.findall(r"[A-Z_]\w+", line)
    }
    assert "defined" not in text
    assert asked - set(re.findall(r"^#define (\w+)", text, re.M)) <= set(PASSES[name])
    assert all(re.search(rf"\b{define}\b", text) for define in PASSES[name])


def test_the_readme_lists_the_same_defines():
    rows = {row[0]: row[-1] for row in re.findall(r"^\| `([\w/]+)` \|(?:[^|]*\|){3}([^|]*)\|$", README, re.M)}
    host = set(Encoding().defines())
    assert rows.keys() == PASSES.keys()
    for name, column in rows.items():
        listed = set(re.findall(r"`([A-Z_]+)`", column)) | (host if "those of `surface/host.glsl`" in column else set())
        assert listed == set(PASSES[name]), name
    assert all(f"`{define}`" in README for define in host)


def test_nobody_else_decides_a_define():
    """Outside the table and the host's encoding no module of the runtime names one."""
    names = "|".join({define for rules in PASSES.values() for define in rules} - {"NORMAL"})
    for path in (GLSL_FOLDER.parent / "runtime").rglob("*.py"):
        if path.name not in ("permutations.py", "host_textures.py"):
            assert not re.search(rf"[\"']({names})[\"']|\b({names})=", path.read_text(encoding="utf-8")), path
