"""The textures and the GLSL of runtime/js: at any point the light that Python reads, from lists that are as short."""

from dataclasses import replace

import numpy as np
import pytest
from glsl_lookup import used
from gsgi_files import example
from javascript import JS, node
from repository import TESTS
from surface_cases import bent, gaussians, points, with_relief
from surface_frames import nothing, one

import gsgi
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl import shader
from gsgi.runtime.gl.gaussian_textures import DATA_WIDTH
from gsgi.runtime.lookup_tables import lookup_tables

TABLES = TESTS / "runtime" / "js" / "tables.mjs"
MAIN = """
in vec3 position;
in vec3 normal;
in vec3 mapped;
out vec3 light;
void main() { light = READ; }
"""
READS = {
    "room0_indirect(position, normal, mapped)": {"mapped": True},
    "room0_indirect(position, normal)": {},
    "room0_indirect_free(position, normal)": {"free": True},
}
FAR = np.float32([2e4, -1e4, 3e4])


def moved(level):
    return replace(level, position=level.position + FAR)


def bakes() -> dict[str, Bake]:
    """As files hold them: quantised."""
    blend = SurfaceBlend(cutoff=0.1, sharpness=3, floor=0.5)
    many = replace(gaussians(3000, sloped=True), scale=gaussians(3000).scale / 8)
    made = {
        "usual": Bake(many, SurfaceBlend(), coarse=gaussians(200, 9)),
        "degree_1": Bake(gaussians(60, 4), blend, coarse=gaussians(20, 1, seed=7)),
        "degree_2": Bake(gaussians(60, 9, sloped=True), blend, coarse=gaussians(20, 4, seed=7)),
        "relief": with_relief(Bake(gaussians(60, 4, sloped=True), blend, coarse=gaussians(20, 4, seed=7))),
        "far": Bake(moved(many), SurfaceBlend(), coarse=moved(gaussians(200, 9))),
        "one": Bake(one(), SurfaceBlend(), coarse=nothing()),
        "empty": Bake(nothing(), SurfaceBlend(), coarse=nothing()),
    }
    return {name: codec.decode(codec.encode(bake)) for name, bake in made.items()}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The bakes, and the folder with what JavaScript makes of them."""
    folder, named = tmp_path_factory.mktemp("tables"), bakes()
    for name, bake in named.items():
        (folder / name).write_bytes(codec.encode(bake))
    node(TABLES, *(folder / name for name in named), JS=JS)
    return named, folder


def textures(gl, file):
    for kind, channels, dtype in (("gaussians", 4, "f4"), ("cells", 1, "u4"), ("lists", 1, "u2")):
        data = file.with_name(f"{file.name}.{kind}").read_bytes()
        size = DATA_WIDTH, len(data) // (DATA_WIDTH * channels * int(dtype[1]))
        texture = gl.texture(size, channels, data, dtype=dtype)
        texture.filter = (gl.NEAREST, gl.NEAREST)
        yield kind, texture


@pytest.mark.parametrize("read", READS)
@pytest.mark.parametrize("name", bakes())
def test_any_point_has_the_light_that_python_reads(gl, made, name, read):
    named, folder = made
    bake, (position, normal) = named[name], points(2000)
    if name == "far":
        position = position + FAR
    source = shader.CORE + (folder / f"{name}.glsl").read_text() + MAIN.replace("READ", read)
    program = gl.program(vertex_shader=source, varyings=["light"])
    for unit, (kind, texture) in enumerate(textures(gl, folder / name)):
        texture.use(unit)
        program[f"room0_{kind}"].value = unit
    mapped = bent(normal)
    given = gl.buffer(np.concatenate([position, normal, mapped], axis=1).astype(np.float32))
    result = gl.buffer(reserve=12 * len(position))
    gl.framebuffer(gl.texture((1, 1), 4)).use()
    vertices = gl.vertex_array(program, [used(program, given, "position", "normal", "mapped")])
    vertices.transform(result, vertices=len(position))
    light = np.frombuffer(result.read(), np.float32).reshape(-1, 3)
    asked = READS[read]
    if "mapped" in asked:
        asked = {"mapped": mapped}
        follows = np.abs(gsgi.sample(bake, position, normal, **asked) - gsgi.sample(bake, position, normal)).mean()
        assert (name == "relief") == (follows > 0.02)
    expected = gsgi.sample(bake, position, normal, **asked)
    level = bake.coarse if "free" in asked else bake.gaussians
    assert (len(level) > 0) == (expected > 0).any()
    np.testing.assert_allclose(light, expected, rtol=1e-3, atol=1e-3)


def test_the_lists_are_as_short_as_those_of_python(made):
    named, folder = made
    for name, bake in named.items():
        _, cells, lists = lookup_tables(bake)
        for kind, table in (("cells", cells), ("lists", lists)):
            rows = (folder / f"{name}.{kind}").stat().st_size / (table.itemsize * DATA_WIDTH)
            assert rows <= -(-len(table) // DATA_WIDTH), (name, kind)


@pytest.mark.parametrize("change", [{"scale": 20}, {"position": 0.01}], ids=["all are large", "all are in one place"])
def test_lists_have_a_limit_whatever_a_file_holds(tmp_path, change):
    many = gaussians(12_000)
    many = replace(many, **{name: np.float32(factor) * getattr(many, name) for name, factor in change.items()})
    (tmp_path / "many").write_bytes(codec.encode(Bake(many, SurfaceBlend(), coarse=gaussians(9, 9))))
    node(TABLES, tmp_path / "many", JS=JS)
    assert (tmp_path / "many.lists").stat().st_size < 400 * len(many)


def test_light_of_the_over_operator_is_refused(tmp_path):
    (tmp_path / "over").write_bytes(codec.encode(example()))
    with pytest.raises(AssertionError, match='RangeError: this needs light of "surface"'):
        node(TABLES, tmp_path / "over", JS=JS)
