"""Light groups in the C library: the light that Python's have, bit for bit, for any weights, and the same refusals."""

import ctypes

import numpy as np
import pytest
from c_library import CONTEXT_LOST, INVALID_ARGUMENT, OK, Context, Light, Lookup, Messages, OpenOptions, check_refusals
from c_light import drawn, of_python
from gl_dump import Dump
from gl_objects import alive
from gsgi_files import example, reseal, surface_example
from host import CAMERA, Host, bake, projection
from surface_cases import grouped, points, with_relief

from gsgi.runtime.file import codec
from gsgi.runtime.file.header import GROUP_TAG, RELIEF_TAG, section
from gsgi.runtime.gl import gaussian_textures
from gsgi.runtime.gl.gaussian_textures import data_rows
from gsgi.runtime.gl.host_textures import OURS
from gsgi.runtime.light_groups import factors_of, weighted
from gsgi.runtime.lookup_tables import lookup_tables
from gsgi.runtime.sampling import sample

ROOM = codec.encode(grouped(bake()))
FILES = {
    "room": ROOM,
    **{f"degree {degree}": codec.encode(grouped(surface_example(300, degree, 40, 2 - degree))) for degree in range(3)},
    "not sloped": codec.encode(grouped(surface_example(sloped=False))),
    "relief": codec.encode(with_relief(grouped(surface_example()))),
    "empty": codec.encode(grouped(surface_example(0, 0, 0, 0))),
}
WEIGHTS = {"lamps": 0.3, "sky": (1, 0.5, 2)}
CASES = [WEIGHTS, {"base": 0, "lamps": 0, "sky": 0}, {"base": (0, 0, 0.1)}, {"sky": 1e15}, {}]


@pytest.mark.parametrize("name", FILES)
def test_weighted_texels_are_those_of_python_to_the_last_bit(library, name):
    data = FILES[name]
    decoded, opened = codec.decode(data), library.opened(data)
    assert library.group_names(opened) == [group.name for group in decoded.groups] == ["base", "lamps", "sky"]
    assert library.functions.gsgi_bake_group_name(opened, ctypes.c_uint32(3)) is None
    before = [library.texels(opened, level) for level in (0, 1)]
    for weights in CASES:
        assert library.weigh(opened, factors_of(decoded, weights)) == OK
        expected = weighted(decoded, weights)
        for level, gaussians in enumerate((expected.gaussians, expected.coarse)):
            found = library.texels(opened, level)
            if not len(gaussians):
                assert found["sh"] is None
                continue
            of_python = {"sh": gaussian_textures._sh_texels(gaussians)}
            if gaussians.sloped:
                of_python["slope"] = np.pad(gaussians.slope, ((0, 0), (0, 2)))
            for kind, texels in of_python.items():
                texels = texels.reshape(-1, 4)
                np.testing.assert_array_equal(found[kind][: len(texels)].view(np.uint32), texels.view(np.uint32))
            np.testing.assert_array_equal(found["shape"], before[level]["shape"])
    assert library.weigh(opened, factors_of(decoded, WEIGHTS)) == library.weigh(opened, None) == OK
    for level in (0, 1):
        for kind, texels in library.texels(opened, level).items():
            np.testing.assert_array_equal(texels, before[level][kind])
    library.close(opened)


def test_files_without_groups_have_none(library):
    for made in (example(), surface_example()):
        opened = library.opened(codec.encode(made))
        assert library.info(opened).group_count == 0
        assert library.functions.gsgi_bake_weigh(opened, ctypes.c_uint32(0), None) == OK
        library.close(opened)


@pytest.mark.parametrize("lists", [False, True])
@pytest.mark.parametrize("splat_scale", [1, 2])
def test_the_pass_shows_the_light_that_python_shows(gl, context, library, host, splat_scale, lists):
    textures, decoded, opened = host.textures(gl, OURS), codec.decode(ROOM), library.opened(ROOM, lists=lists)
    arguments = textures, CAMERA.view_from_world, projection()
    gl.error  # noqa: B018  reading it clears what earlier tests left
    light = Light(context, ROOM, OURS, splat_scale, lists=lists)
    before = drawn(gl, light, textures)
    for weights in (WEIGHTS, {"sky": 0}, {}):
        assert library.weigh(opened, factors_of(decoded, weights)) == OK
        dump = Dump(gl)
        gl.error  # noqa: B018  what the dump and Python's pass left
        assert light.recolour(opened) == OK, context.messages
        assert dump.changed() == set()
        found = drawn(gl, light, textures)
        assert (gl.error, context.messages) == ("GL_NO_ERROR", [])
        expected = of_python(gl, ROOM, *arguments, splat_scale=splat_scale, weights=weights)
        if "llvmpipe" in gl.info["GL_RENDERER"]:
            np.testing.assert_array_equal(found, expected)
        assert np.array_equal(found, before) == (not weights)
    light.destroy()
    library.close(opened)


def test_nothing_is_made_for_weights(fresh_gl, library):
    context, opened = Context(library, fresh_gl), library.opened(ROOM)
    light, textures = Light(context, ROOM, OURS), Host(fresh_gl).textures(fresh_gl, OURS)
    drawn(fresh_gl, light, textures)
    before = alive(fresh_gl)
    for value in (0.5, 0.0, 1.0):
        assert library.weigh(opened, dict.fromkeys(("base", "lamps", "sky"), (value,) * 3)) == OK
        assert light.recolour(opened) == OK
    assert alive(fresh_gl) == before
    library.functions.gsgi_context_forget(context.handle)
    assert light.recolour(opened) == CONTEXT_LOST
    light.destroy()
    context.destroy()
    library.close(opened)


@pytest.mark.parametrize("name", ["room", "degree 2"])
def test_the_look_up_reads_the_light_that_python_reads(gl, context, library, name):
    data = FILES[name]
    decoded, opened, lookup = codec.decode(data), library.opened(data), Lookup(library, data)
    gl.error  # noqa: B018  reading it clears what earlier tests left
    names = lookup.upload(context)
    for weights in (WEIGHTS, {}):
        assert library.weigh(opened, factors_of(decoded, weights)) == OK
        assert lookup.recolour(opened) == OK
        lookup.read()
        expected = data_rows(lookup_tables(weighted(decoded, weights))[0]).reshape(-1, 4)
        np.testing.assert_allclose(lookup.tables["gsgi_gaussians"], expected, rtol=1e-6, atol=1e-6)
        texture = names["gsgi_gaussians"]
        update = library.functions.gsgi_lookup_update
        assert update(context.handle, lookup.handle, ctypes.c_uint32(texture)) == OK
        made = gl.external_texture(texture, (2048, lookup.info.gaussian_rows), 4, 0, "f4")
        assert made.read() == lookup.tables["gsgi_gaussians"].tobytes()
    assert (gl.error, context.messages) == ("GL_NO_ERROR", [])
    lookup.close()
    library.close(opened)


@pytest.mark.parametrize("sampling", [False, True])
def test_light_at_points_is_that_of_python(library, sampling):
    decoded, opened = codec.decode(ROOM), library.opened(ROOM, sampling)
    position, normal = points(500)
    beyond_halves = {"base": 1e5, "lamps": 1e6}
    for weights in (WEIGHTS, {"base": 0}, beyond_halves, {}):
        assert library.weigh(opened, factors_of(decoded, weights)) == OK
        expected = sample(decoded, position, normal, weights)
        atol = 1e-1 if weights is beyond_halves else 1e-5
        np.testing.assert_allclose(library.sample(opened, position, normal), expected, rtol=1e-4, atol=atol)
        assert (expected > 0.01).mean() > 0.1
    library.close(opened)


def test_mistakes_are_named(gl, context, library):
    messages = Messages()
    result, opened = library.open(ROOM, OpenOptions(callbacks=messages.callbacks))
    assert result == OK
    before = library.texels(opened, 0)["sh"]
    weigh, one = library.functions.gsgi_bake_weigh, (ctypes.c_float * 9)(*[1] * 9)
    assert weigh(opened, ctypes.c_uint32(2), one) == INVALID_ARGUMENT
    assert messages[-1] == "group_count: the bake has 3 groups, got 2"
    for value in (-0.5, np.nan, np.inf, 2e15):
        one[4] = value
        assert weigh(opened, ctypes.c_uint32(3), one) == INVALID_ARGUMENT
        assert messages[-1].startswith("weights: 'lamps': expected three numbers from 0 to 1e+15, got ")
    np.testing.assert_array_equal(library.texels(opened, 0)["sh"], before)
    other = library.opened(codec.encode(grouped(bake(), seed=1)))
    light, lookup = Light(context, ROOM, OURS), Lookup(library, ROOM)
    assert light.recolour(other) == lookup.recolour(other) == INVALID_ARGUMENT
    assert context.messages == ["bake: not the one that the light was made of"]
    light.destroy()
    lookup.close()
    library.close(other)
    light = Light(context, ROOM, OURS, lists=True)
    assert light.recolour(opened) == INVALID_ARGUMENT
    assert context.messages[-1] == "bake: opened without `lists`, with which the light's was"
    light.destroy()
    library.close(opened)


def test_sections_that_may_not_be_there_are_refused_as_python_refuses_them(library):
    over, surface = codec.encode(example(3)), codec.encode(with_relief(grouped(surface_example(3))))
    for tag in (GROUP_TAG, RELIEF_TAG):
        assert check_refusals(library, reseal(over + section(tag, b"")))
        assert check_refusals(library, reseal(surface + section(tag, b"12345")))
    assert not check_refusals(library, reseal(surface + section(b"LATE", b"12345")))


def group() -> bytes:
    """The content of the section of a group, the first of a file."""
    data = codec.encode(grouped(surface_example(3, 0, 2, 1)))
    found = data.index(GROUP_TAG, data.index(GROUP_TAG) + 1)  # "lamps"
    return data[found + 8 : found + 8 + int.from_bytes(data[found + 4 : found + 8], "little")]


def test_damaged_groups_are_refused_as_python_refuses_them(library):
    plain, good, rng = codec.encode(surface_example(3, 0, 2, 1)), group(), np.random.default_rng(4)
    refused = []

    def check(content: bytes, *more: bytes) -> None:
        sections = b"".join(section(GROUP_TAG, each) for each in (content, *more))
        refused.append(check_refusals(library, reseal(plain + sections)))

    for length in range(len(good) + 1):
        check(good[:length])
    assert refused == [True] * len(good) + [False]
    for text in (b"\xff", b"\n", b"\xc0", b"\x7f", b"\0"):
        check(good[:5] + text + good[6:])
        check(good[:12] + text + good[13:])
    check(good[:5] + "\u00fc".encode() + good[7:])
    check(good[:5] + "\u20ac".encode() + good[8:])
    check(good[:3] + bytes([4]) + good[4:5] + b"base" + good[10:])
    check(good[:4] + bytes([0]) + good[5:10] + good[17:])
    check(good, good)
    check(good + b"\0")
    assert all(refused[-4:])
    for _ in range(300):
        broken = bytearray(good)
        broken[rng.integers(len(good))] = rng.integers(256)
        if bytes(broken[5:10]).decode("latin1").isprintable():
            check(bytes(broken))
    assert 0.05 < np.mean(refused[-250:]) < 0.95
