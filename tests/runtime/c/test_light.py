"""The C library's light pass against IndirectLight in the same context: the same pixels, bit for bit on llvmpipe."""

import itertools

import numpy as np
import pytest
from c_library import OK, Context, Light
from c_light import OVER, SURFACE, check_same, drawn, of_c, of_python
from host import (
    CAMERA,
    SIZE,
    TURNS,
    UPPER_LEFT,
    ZERO_TO_ONE,
    bake,
    call,
    orthographic,
    pixels,
    projection,
    projection_for,
    rasterised,
    rg16,
    texture,
    turned,
)

from gsgi.runtime.file import codec
from gsgi.runtime.gl.host_textures import ALBEDOS, DEPTHS, NORMALS, SPACES, Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight


@pytest.mark.parametrize("file", [SURFACE, OVER], ids=["surface", "over"])
def test_lists_that_were_made_before_give_the_same_pixels(gl, context, library, host, file):
    """They are made without OpenGL, and count in the bake's bytes."""
    textures = host.textures(gl, Encoding())
    plain, ready = library.opened(file), library.opened(file, lists=True)
    more = library.info(ready).bake_bytes - library.info(plain).bake_bytes
    images = []
    for lists in (False, True):
        light = Light(context, file, Encoding(), lists=lists)
        images.append(drawn(gl, light, textures))
        assert more == (light.stats().gaussian_bytes if file == SURFACE else 0)
        light.destroy()
    np.testing.assert_array_equal(*images)
    for opened in (plain, ready):
        library.close(opened)


@pytest.mark.parametrize("splat_scale", [1, 2, 3, 4])
def test_the_pixels_are_those_of_python(gl, context, host, splat_scale):
    textures = host.textures(gl, Encoding())
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, projection(), splat_scale=splat_scale)


@pytest.mark.parametrize(("depth", "normal", "space"), list(itertools.product(DEPTHS, NORMALS, SPACES)))
def test_so_they_are_in_every_encoding(gl, context, host, depth, normal, space):
    encoding = Encoding(depth, normal, space)
    textures, clip = host.textures(gl, encoding), projection_for(encoding)
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, clip, encoding=encoding)


def test_octahedral_normals_in_a_texture_of_16_bits(gl, context, host):
    encoding = Encoding("window", "octahedral unsigned")
    textures = host.textures(gl, encoding)[0], rg16(gl, host.normal)
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, projection(), encoding=encoding)


def test_the_pixels_of_over_are_those_of_python(gl, context, host):
    textures = host.textures(gl, Encoding())
    check_same(gl, context, OVER, textures, CAMERA.view_from_world, projection())


@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
def test_a_part_of_the_image_off_the_axis(gl, context, host, data):
    part = (16, 8, 48, 40)
    textures = host.textures(gl, Encoding())
    check_same(gl, context, data, textures, CAMERA.view_from_world, projection(part=part), viewport=part)


def test_a_mirrored_projection(gl, context, host):
    mirror = np.diag([1.0, -1, 1, 1])
    textures = host.textures(gl, Encoding())
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, mirror @ projection())


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("splat_scale", [1, 2])
@pytest.mark.parametrize("kind", ["window", "zero to one", "reversed", "linear"])
def test_an_orthographic_camera_in_another_view_space(gl, context, host, kind, splat_scale, turn):
    encoding = Encoding(kind, "signed", "view")
    straight = orthographic("window" if kind == "linear" else kind)
    view, clip = turned(CAMERA.view_from_world, straight, turn)
    textures = host.textures(gl, encoding, view, straight)
    check_same(gl, context, SURFACE, textures, view, clip, encoding=encoding, splat_scale=splat_scale)


@pytest.mark.parametrize("turn", TURNS)
def test_a_view_space_of_another_engine(gl, context, host, turn):
    encoding = Encoding("window", "signed", "view")
    view, clip = turned(CAMERA.view_from_world, projection(), turn)
    check_same(gl, context, SURFACE, host.textures(gl, encoding, view), view, clip, encoding=encoding)


@pytest.mark.parametrize("depth", ["window", "zero to one", "reversed"])
@pytest.mark.parametrize("depth_range", [(0.25, 0.75), (1.0, 0.0), (0.875, 0.5)])
def test_a_depth_range_of_the_hosts_own(gl, context, host, depth, depth_range):
    encoding = Encoding(depth, "signed", depth_range=depth_range)
    clip = projection_for(encoding)
    check_same(gl, context, SURFACE, host.textures(gl, encoding), CAMERA.view_from_world, clip, encoding=encoding)


def test_a_box_is_all_that_is_lit(gl, context, host):
    textures, box = host.textures(gl, Encoding()), np.array([[-9, -9, -9], [0, 9, 9]])
    check_same(gl, context, SURFACE, textures, CAMERA.view_from_world, projection(), box=box)


def test_far_from_the_origin(gl, context, host):
    offset = np.float32([256, -512, 256])
    data, pose = codec.encode(bake(offset=offset)), CAMERA.world_from_view.copy()
    pose[:3, 3] += offset
    textures, view = host.textures(gl, Encoding()), np.linalg.inv(pose)
    check_same(gl, context, data, textures, view, projection(), splat_scale=1)


@pytest.mark.parametrize("data", [SURFACE, OVER], ids=["surface", "over"])
@pytest.mark.parametrize(("kind", "depth"), [("zero to one", "zero to one"), ("reversed, far", "reversed")])
def test_textures_of_another_clip_control(fresh_gl, library, data, kind, depth):
    """A depth buffer of 0 <= z <= w whose first row is on top, which Python reads off the context."""
    gl, view, clip = fresh_gl, CAMERA.view_from_world, projection(kind)
    if "GL_ARB_clip_control" not in gl.extensions:
        pytest.skip("the driver has no glClipControl")
    call(gl, "ClipControl", UPPER_LEFT, ZERO_TO_ONE)
    textures = rasterised(gl, clip, depth == "reversed")
    expected = of_python(
        gl, data, textures, view, clip, encoding=Encoding(depth.replace("zero to one", "window"), "signed")
    )
    context = Context(library, gl)
    found = of_c(gl, context, data, textures, view, clip, encoding=Encoding(depth, "signed"), top_down=True)
    np.testing.assert_array_equal(found, expected)
    context.destroy()


@pytest.mark.parametrize("albedo", ALBEDOS)
def test_light_is_added_as_python_adds_it(gl, context, host, albedo):
    encoding, part = Encoding(albedo=albedo), (16, 8, 48, 40)
    rng = np.random.default_rng(0)
    stored, before = (rng.uniform(0, 1, (SIZE[1], SIZE[0], 4)).astype(np.float32) for _ in range(2))
    stored[0, 0] = stored[20, 30] = np.nan
    reflectance, textures = texture(gl, stored), host.textures(gl, encoding)
    matrices = np.float32(CAMERA.view_from_world), np.float32(projection(part=part))

    colours = [texture(gl, before) for _ in range(2)]
    targets = [gl.framebuffer([colour, gl.texture(SIZE, 4)], gl.depth_renderbuffer(SIZE)) for colour in colours]
    python = IndirectLight(gl, codec.decode(SURFACE), encoding)
    python.draw(*textures, *matrices, part)
    python.add(targets[0], reflectance)
    python.release()
    light = Light(context, SURFACE, encoding)
    assert light.cull(*matrices, part) == OK
    assert light.draw(*(made.glo for made in textures))[0] == OK
    assert light.add(targets[1].glo, reflectance.glo) == OK, context.messages
    light.destroy()
    expected, found = (pixels(colour) for colour in colours)
    np.testing.assert_array_equal(found, expected)
    assert (found != before).any(axis=-1).mean() > 0.2
    assert not np.frombuffer(targets[1].read(attachment=1, components=4), np.uint8).any()
