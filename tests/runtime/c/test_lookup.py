"""The C library's look-up against Python's: the same tables, byte for byte on x86-64, and the same source."""

import platform
from dataclasses import replace

import moderngl
import numpy as np
import pytest
from c_library import OK, UNSUPPORTED, Context, Lookup
from c_light import OVER, SURFACE, read_floats
from gl_dump import Dump
from gsgi_files import constant, surface_example
from host import bake
from oracle import random_gaussians
from surface_cases import grouped, with_relief

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl.gaussian_textures import data_rows
from gsgi.runtime.gl.indirect_lookup import lookup_source
from gsgi.runtime.lookup_tables import lookup_tables

RANDOM = np.random.default_rng(5).uniform(-1, 1, (300, 3)).astype(np.float32)


def large() -> Bake:
    """As many small Gaussians as make several depths of the tree, about a plane."""
    fine, rng = random_gaussians(3000, 0, seed=1, sloped=True), np.random.default_rng(2)
    fine.position[:] = rng.uniform(-2, 2, (3000, 3)) * [1, 0.05, 1]
    fine.scale[:] = rng.uniform(0.02, 0.08, (3000, 3)) * [1, 0.05, 1]
    return Bake(fine, SurfaceBlend(), coarse=random_gaussians(40, 2, seed=3))


BAKES = {
    "room": bake(), "far away": bake(offset=(1000.25, -2000.5, 300.125)), "one Gaussian": constant([0.5, 0.25, 1]),
    "degrees 0 and 2": surface_example(degree=0, coarse_degree=2), "degrees 2 and 1": surface_example(300, 2, 30, 1),
    "no fine ones": surface_example(0), "3,000": large(), "relief": with_relief(surface_example(300, 1, 30, 2)),
    "relief of groups": with_relief(grouped(surface_example(60, 0, 9, 2))),
    "relief of none": with_relief(surface_example(0)),
}  # fmt: skip


@pytest.mark.parametrize("name", BAKES)
def test_the_tables_are_those_of_python(library, name):
    data = codec.encode(BAKES[name])
    found, decoded = Lookup(library, data), codec.decode(data)
    assert found.result == OK
    assert found.info.source.decode().split() == lookup_source(decoded).split()
    expected = dict(zip(found.tables, lookup_tables(decoded), strict=True))
    for table, texels in expected.items():
        rows = data_rows(texels).reshape(-1, texels.shape[1])
        assert found.tables[table].dtype == rows.dtype
        if platform.machine() in ("x86_64", "AMD64"):
            np.testing.assert_array_equal(found.tables[table], rows, err_msg=table)
    assert found.info.bytes == sum(table.nbytes for table in found.tables.values())
    found.close()


@pytest.mark.parametrize("name", BAKES)
def test_a_file_tells_what_its_gaussians_take(library, name):
    """Without relief and lists."""
    decoded, opened = codec.decode(data := codec.encode(BAKES[name])), library.opened(data)
    flat = replace(decoded, gaussians=replace(decoded.gaussians, relief=None))
    assert library.info(opened).light_bytes == data_rows(lookup_tables(flat)[0]).nbytes
    library.close(opened)


def draw(ctx, version: str, source: str, names: dict[str, int]) -> np.ndarray:
    """B (N, 3) at RANDOM by a shader that contains `source`."""
    at = ctx.texture((len(RANDOM), 1), 3, RANDOM.tobytes(), dtype="f4")
    program = ctx.program(
        vertex_shader=version + "void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0,"
        " gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }",
        fragment_shader=version + source + "uniform sampler2D at; out vec4 light; void main() {"
        " vec3 x = texelFetch(at, ivec2(gl_FragCoord.xy), 0).xyz; light = vec4(gsgi_indirect(x, x.yzx), 1.0); }",
    )
    for unit, (name, texture) in enumerate(names.items(), start=1):
        kinds = {"gsgi_gaussians": (4, "f4"), "gsgi_cells": (1, "u4"), "gsgi_lists": (1, "u2")}[name]
        ctx.external_texture(texture, (2048, 1), kinds[0], 0, kinds[1]).use(unit)
        program[name].value = unit
    at.use(0)
    program["at"].value = 0
    target = ctx.texture((len(RANDOM), 1), 4, dtype="f4")
    ctx.framebuffer(target).use()
    ctx.enable_only(moderngl.NOTHING)
    ctx.vertex_array(program, []).render(vertices=3)
    return read_floats(ctx, target.glo, target.size)[0, :, :3]


ES = "#version 300 es\nprecision highp float; precision highp int; precision highp sampler2D;\n"


@pytest.mark.parametrize(
    ("api", "version"), [("gl", "#version 330\n"), ("gl", ES), ("es_gl", ES)], ids=["330", "300 es", "OpenGL ES"]
)
def test_its_textures_serve_a_shader(request, library, api, version):
    gl = request.getfixturevalue(api)
    context, lookup = Context(library, gl), Lookup(library, SURFACE)
    gl.error  # noqa: B018  reading it clears what earlier tests left
    dump = Dump(gl)
    names = lookup.upload(context)
    assert (gl.error, context.messages) == ("GL_NO_ERROR", [])
    assert dump.changed() == set()
    found = draw(gl, version, lookup.info.source.decode(), names)
    context.destroy()
    bake = library.opened(SURFACE, sampling=True)
    expected = library.sample(bake, RANDOM, RANDOM[:, [1, 2, 0]])
    library.close(bake)
    lookup.close()
    assert expected.mean() > 0.1
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)


def test_the_operator_over_has_none(library):
    assert Lookup(library, OVER).result == UNSUPPORTED
