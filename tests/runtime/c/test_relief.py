"""Light that follows normal maps in the C library: the pixels of Python, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from c_library import INVALID_ARGUMENT, OK, Context, Light, check_refusals
from c_light import WHOLE, check_same, drawn, of_c, of_python, read_floats, texels
from gl_dump import Dump
from gl_objects import alive
from gsgi_files import reseal, surface_example
from host import CAMERA, SIZE, Host, bake, call, projection, texture
from surface_cases import bent as bent_normals
from surface_cases import grouped, points, with_relief

from gsgi.runtime.file import codec
from gsgi.runtime.file.header import RELIEF_TAG, section
from gsgi.runtime.gl.gaussian_textures import data_rows
from gsgi.runtime.gl.gl_state import HostState
from gsgi.runtime.gl.host_textures import OURS, Encoding
from gsgi.runtime.light_groups import factors_of, weighted
from gsgi.runtime.lookup_tables import lookup_tables
from gsgi.runtime.sampling import sample

ROOM = codec.encode(with_relief(grouped(bake())))
SIGNED = Encoding(normal="signed")


def bent(gl, host, seed: int = 0):
    """Normals as a map bends them; some of them are missing."""
    rng = np.random.default_rng(seed)
    normal = host.normal + rng.uniform(-0.6, 0.6, host.normal.shape)
    normal[rng.uniform(size=normal.shape[:2]) < 0.1] = 0
    return texture(gl, np.concatenate([normal, np.ones((*normal.shape[:2], 1))], axis=-1))


@pytest.mark.parametrize("sloped", [True, False])
@pytest.mark.parametrize("degree", [0, 2])
def test_relief_is_decoded_to_the_last_bit_and_weighed(library, degree, sloped):
    data = codec.encode(with_relief(grouped(surface_example(300, degree, sloped=sloped))))
    decoded, opened = codec.decode(data), library.opened(data)
    assert library.info(opened).relief == 1
    for weights in ({}, {"lamps": 0.3, "sky": (1, 0.5, 2)}, {"base": 0, "lamps": 0, "sky": 0}, {}):
        assert library.weigh(opened, factors_of(decoded, weights)) == OK
        relief = weighted(decoded, weights).gaussians.relief
        expected = np.pad(relief, ((0, 0), (0, 0), (0, 1))).reshape(-1, 4)
        found = library.texels(opened, 0)["relief"]
        np.testing.assert_array_equal(found[: len(expected)].view(np.uint32), expected.view(np.uint32))
        assert not found[len(expected) :].any()
    assert library.texels(opened, 1)["relief"] is None
    library.close(opened)
    plain = library.opened(codec.encode(surface_example()))
    assert (library.info(plain).relief, library.texels(plain, 0)["relief"]) == (0, None)
    library.close(plain)


@pytest.mark.parametrize("sampling", [True, False])
def test_light_at_points_follows_normal_maps(library, sampling):
    for data in (ROOM, codec.encode(with_relief(surface_example(300, 1)))):
        opened, (position, normal) = library.opened(data, sampling=sampling), points(300)
        mapped = bent_normals(normal)
        found = library.sample(opened, position, normal, mapped)
        np.testing.assert_allclose(
            found, sample(codec.decode(data), position, normal, mapped=mapped), rtol=1e-4, atol=1e-5
        )
        flat = library.sample(opened, position, normal)
        assert np.abs(found - flat).mean() > 0.01
        np.testing.assert_array_equal(library.sample(opened, position, normal, 0 * mapped), flat)
        library.close(opened)


@pytest.mark.parametrize("splat_scale", [1, 2])
def test_the_pixels_are_those_of_python(gl, context, host, splat_scale):
    arguments = ROOM, host.textures(gl, SIGNED), CAMERA.view_from_world, projection()
    how = {"encoding": SIGNED, "splat_scale": splat_scale, "relief": True}
    mapped = bent(gl, host)
    check_same(gl, context, *arguments, mapped=mapped, **how)
    check_same(gl, context, *arguments, **how)
    curved, flat = (of_c(gl, context, *arguments, mapped=m, **how).view(np.float32) for m in (mapped, None))
    assert np.abs(curved - flat).mean() > 0.01


def test_opengl_es_draws_the_same(gl, host, request, library):
    arguments = CAMERA.view_from_world, projection()
    expected = of_python(gl, ROOM, host.textures(gl, SIGNED), *arguments, encoding=SIGNED, mapped=bent(gl, host))
    es = request.getfixturevalue("es_gl")
    context = Context(library, es)
    light = Light(context, ROOM, SIGNED, relief=True)
    assert light.cull(*arguments, WHOLE) == OK
    result, name = light.draw(*(made.glo for made in (*host.textures(es, SIGNED), bent(es, host))))
    assert result == OK, context.messages
    np.testing.assert_array_equal(read_floats(es, name, SIZE).view(np.uint32), expected)
    light.destroy()
    context.destroy()


def test_a_light_that_does_not_ask_for_relief_has_none(gl, context, host):
    textures, how = host.textures(gl, SIGNED), {"encoding": SIGNED}
    arguments = ROOM, textures, CAMERA.view_from_world, projection()
    expected = of_python(gl, *arguments, relief=False, **how)
    for mapped in (None, bent(gl, host)):
        np.testing.assert_array_equal(of_c(gl, context, *arguments, mapped=mapped, **how), expected)
    lights = [Light(context, ROOM, SIGNED, relief=relief) for relief in (False, True)]
    for light in lights:
        drawn(gl, light, textures)
    plain, more = (light.stats() for light in lights)
    decoded = codec.decode(ROOM)
    flat = replace(decoded, gaussians=replace(decoded.gaussians, relief=None))
    for stats, read in ((plain, flat), (more, decoded)):
        assert stats.gaussian_bytes == sum(data_rows(table).nbytes for table in lookup_tables(read))
    assert more.gaussian_bytes > plain.gaussian_bytes
    assert more.target_bytes - plain.target_bytes == 8 * (SIZE[0] // 2) * (SIZE[1] // 2)
    for light in lights:
        light.destroy()


def test_the_host_finds_its_state_again_and_nothing_is_left(fresh_gl, library):
    host = Host(fresh_gl)
    textures, mapped = host.textures(fresh_gl, SIGNED), bent(fresh_gl, host)
    arguments = ROOM, textures, CAMERA.view_from_world, projection()
    expected = of_python(fresh_gl, *arguments, encoding=SIGNED, mapped=mapped)
    before = alive(fresh_gl)
    context = Context(library, fresh_gl)
    light = Light(context, ROOM, SIGNED, relief=True)
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    for unit in range(8):
        textures[0].use(unit)
    call(fresh_gl, "ColorMaski", 2, 0, 0, 0, 0)
    call(fresh_gl, "Enablei", 0x0BE2, 2)
    dump = Dump(fresh_gl)
    result, name = light.draw(*(made.glo for made in (*textures, mapped)))
    assert result == OK, context.messages
    assert dump.changed() == set()
    state = HostState(fresh_gl)
    with state.kept():
        np.testing.assert_array_equal(texels(name, fresh_gl, SIZE), expected)
    state.release()
    light.destroy()
    context.destroy()
    assert alive(fresh_gl) == before


def test_mapped_normals_that_cannot_be_right_are_named(gl, context, host):
    light, textures = Light(context, ROOM, OURS, relief=True), host.textures(gl, OURS)
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    names = [made.glo for made in textures]
    for made, message in (
        (gl.depth_texture(SIZE), "mapped: a depth buffer"),
        (gl.texture(SIZE, 1, dtype="f4"), "mapped: needed are three channels"),
        (gl.texture((8, 8), 4, dtype="f4"), "mapped: its size is not that of normal"),
    ):
        assert light.draw(*names, made.glo)[0] == INVALID_ARGUMENT
        assert context.messages[-1].startswith(message)
        made.release()
    light.destroy()


def test_damaged_relief_is_refused_as_python_refuses_it(library):
    plain = codec.encode(surface_example(3, 0, 2, 1))
    whole, rng = codec.encode(with_relief(surface_example(3, 0, 2, 1))), np.random.default_rng(5)
    good = whole[len(plain) + 8 :]
    refused = [check_refusals(library, reseal(plain + section(RELIEF_TAG, good[:n]))) for n in range(len(good) + 1)]
    assert refused == [True] * len(good) + [False]
    assert check_refusals(library, reseal(plain + section(RELIEF_TAG, b"\0" + good[1:])))
    assert check_refusals(library, reseal(plain + section(RELIEF_TAG, good + b"\0")))
    for _ in range(150):
        broken = bytearray(good)
        broken[rng.integers(len(good))] = rng.integers(256)
        refused.append(check_refusals(library, reseal(plain + section(RELIEF_TAG, bytes(broken)))))
    assert 0.05 < np.mean(refused[-150:]) < 0.95
