"""What a host may hand to the light pass, and the errors that name what it may not."""

import ctypes
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest
import scenes
from host import CAMERA, SIZE, Host, bake, call, pixels, projection, texture

import gsgi
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.indirect_lookup import IndirectLookup
from gsgi.runtime.gl.renderer import DeferredRenderer

HALF = SIZE[0] // 2, SIZE[1] // 2


def made(gl, channels=4, dtype="f4", size=SIZE, **how) -> moderngl.Texture:
    return gl.texture(size, channels, dtype=dtype, **how)


def srgb(gl) -> moderngl.Texture:
    return made(gl, 4, "f1", internal_format=0x8C43)


def layers(gl) -> moderngl.TextureArray:
    return gl.texture_array((*SIZE, 2), 1, dtype="f4")


# Encodings of depth and normal, what makes the two textures, what the error says.
DRAWS = {
    "half-size normals": ("linear", "signed", lambda gl: (made(gl, 1), made(gl, size=HALF)), "normal: 48 x 32 px"),
    "one channel": ("linear", "signed", lambda gl: (made(gl, 1), made(gl, 1)), "normal: .* 1 channel of 32 bits"),
    "two channels": ("linear", "signed", lambda gl: (made(gl, 1), made(gl, 2)), "normal: .* 2 channels .* needs 3"),
    "integers": ("linear", "signed", lambda gl: (made(gl, 1), made(gl, 4, "i2")), "normal: integer texels with 4"),
    "no signs": ("linear", "signed", lambda gl: (made(gl, 1), made(gl, 4, "f1")), 'normal: .* "unsigned"'),
    "no signs of two": ("linear", "octahedral", lambda gl: (made(gl, 1), made(gl, 2, "f1")), 'normal: .* "oct.* unsig'),
    "sRGB": ("linear", "unsigned", lambda gl: (made(gl, 1), srgb(gl)), "normal: .* sRGB"),
    "swapped": ("window", "signed", lambda gl: (made(gl), gl.depth_texture(SIZE)), "normal: .* swapped"),
    "multisampled": ("window", "signed", lambda gl: (gl.depth_texture(SIZE, samples=4), made(gl)), "depth: has 4 samp"),
    "layers": ("linear", "signed", lambda gl: (layers(gl), made(gl)), "depth: .* TextureArray"),
    "a depth buffer as metres": ("linear", "signed", lambda gl: (gl.depth_texture(SIZE), made(gl)), "depth: .* metres"),
    "colours as depth": ("window", "signed", lambda gl: (made(gl, 4, "f1"), made(gl)), "depth: .* 8 bits"),
    "integers as depth": ("window", "signed", lambda gl: (made(gl, 1, "u4"), made(gl)), "depth: integer"),
    "no texture": ("window", "signed", lambda gl: (gl.depth_renderbuffer(SIZE), made(gl)), "depth: .* Renderbuffer"),
    "another target": (
        "linear", "signed", lambda gl: (gl.external_texture(layers(gl).glo, SIZE, 1, 0, "f4"), made(gl)),
        "depth: .* no 2D texture",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWS)
def test_textures_that_cannot_be_what_the_encoding_says_are_named(gl, name):
    depth, normal, textures, message = DRAWS[name]
    light = IndirectLight(gl, bake(), Encoding(depth, normal), splat_scale=1)
    if name == "multisampled" and gl.max_samples < 4:
        pytest.skip("the driver has no multisampling")
    made_here = textures(gl)
    _ = gl.error  # of tests before this one
    with pytest.raises(ValueError, match=f"^{message}"):
        light.draw(*made_here, CAMERA.view_from_world, projection())
    assert gl.error == "GL_NO_ERROR"
    light.release()


@pytest.mark.parametrize(
    "part", [(0, 0, 97, 64), (1, 0, 96, 64), (0, -1, 9, 9), (0, 0, 0, 9), (0, 0, 9), (0, 0, 9.5, 9)]
)
def test_a_viewport_outside_the_textures_is_named(gl, part):
    light = IndirectLight(gl, bake(), splat_scale=1)
    with pytest.raises(ValueError, match=r"^viewport: .* within textures of 96 x 64 px"):
        light.draw(made(gl, 1), made(gl), CAMERA.view_from_world, projection(), viewport=part)
    light.release()


@pytest.mark.parametrize(
    ("depth", "kind"),
    [
        ("window", "reversed"),
        ("window", "reversed, far"),
        ("window", "reversed, one to minus one"),
        ("reversed", "window"),
        ("reversed", "zero to one"),
        ("reversed", "reversed, one to minus one"),
    ],
)
def test_an_encoding_that_contradicts_the_projection_is_named(gl, depth, kind):
    light = IndirectLight(gl, bake(), Encoding(depth), splat_scale=1)
    with pytest.raises(ValueError, match=f'^clip_from_view: .*Encoding.depth .*"{depth}"'):
        light.draw(gl.depth_texture(SIZE), made(gl), CAMERA.view_from_world, projection(kind))
    light.release()


@pytest.mark.parametrize("kind", ["reversed", "reversed, far", "zero to one", "reversed, one to minus one"])
def test_metres_need_no_certain_projection(gl, kind):
    host, light = Host(gl), IndirectLight(gl, bake(), splat_scale=1)
    textures = host.textures(gl, light.encoding)
    found = pixels(light.draw(*textures, CAMERA.view_from_world, projection(kind)))
    np.testing.assert_allclose(found[..., :3], host.indirect, rtol=2e-3, atol=1e-4)
    light.release()


@pytest.fixture
def ready(gl):
    """A light that has drawn, and what it can be added to."""
    host, light = Host(gl), IndirectLight(gl, bake(), splat_scale=1)
    light.draw(*host.textures(gl, light.encoding), CAMERA.view_from_world, projection())
    yield SimpleNamespace(light=light, target=gl.framebuffer(made(gl)), albedo=made(gl))
    light.release()


def test_light_is_added_to_the_first_attachment_alone(gl, ready):
    """Its masks and draw buffers are kept."""
    first, others = (
        texture(gl, np.zeros((SIZE[1], SIZE[0], 4))),
        [texture(gl, np.full((SIZE[1], SIZE[0], 4), 0.25)) for _ in range(3)],
    )
    white = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))
    target = gl.framebuffer([first, *others])
    masks = (True, True, False, True), (True,) * 4, (False,) * 4, (True,) * 4
    target.color_mask = masks
    target.use()
    call(gl, "DrawBuffers", 1, (ctypes.c_int * 1)(0x8CE2))
    ready.light.add(target, white)
    call(gl, "GetIntegerv", 0x8825, drawn := (ctypes.c_int * 1)())
    assert drawn[0] == 0x8CE2
    added, light = pixels(first)[..., :3], pixels(ready.light.indirect)[..., :3]
    np.testing.assert_array_equal(added[..., :2], light[..., :2])
    assert not added[..., 2].any()
    assert all((pixels(other) == 0.25).all() for other in others)
    assert target.color_mask == masks


def test_an_attachment_that_is_read_is_named(gl, ready):
    gbuffer = gl.framebuffer([made(gl), ready.albedo])
    for target in (gbuffer, gl.detect_framebuffer(gbuffer.glo)):
        with pytest.raises(ValueError, match=r"^target: albedo is one of its attachments"):
            ready.light.add(target, ready.albedo)
    with pytest.raises(ValueError, match=r"^target: "):
        ready.light.add(gl.framebuffer(ready.light.indirect), ready.albedo)


def test_what_light_cannot_be_added_to_or_with_is_named(gl, ready):
    light, target, albedo = ready.light, ready.target, ready.albedo
    for other, message in (
        (gl.framebuffer(made(gl, size=HALF)), "target: 48 x 32 px, needed are the 96 x 64 px"),
        (gl.framebuffer(depth_attachment=gl.depth_texture(SIZE)), "target: has no colour attachment"),
        (made(gl), "target: a moderngl.Framebuffer is needed, got Texture"),
        (gl.framebuffer(gl.renderbuffer(SIZE, samples=4, dtype="f2")), "target: has 4 samples per pixel"),
        (gl.framebuffer(gl.renderbuffer(SIZE)), "target: its first attachment is unsigned; linear radiance needs"),
        (gl.framebuffer(gl.texture(SIZE, 4, internal_format=0x8C43)), "target: its first attachment is sRGB"),
        (gl.framebuffer(made(gl, 4, "u1")), "target: its first attachment is integer"),
    ):
        with pytest.raises(ValueError, match=f"^{message}"):
            light.add(other, albedo)
    for other, message in (
        (made(gl, size=HALF), "albedo: 48 x 32 px"),
        (made(gl, 1), "albedo: .* 1 channel"),
        (made(gl, 4, "u1"), "albedo: integer"),
        (gl.depth_texture(SIZE), "albedo: depth"),
    ):
        with pytest.raises(ValueError, match=f"^{message}"):
            light.add(target, other)


def test_an_albedo_is_decoded_once(gl):
    host, light = Host(gl), IndirectLight(gl, bake(), Encoding(albedo="srgb"), splat_scale=1)
    light.draw(*host.textures(gl, light.encoding), CAMERA.view_from_world, projection())
    with pytest.raises(ValueError, match=r"^albedo: .* sRGB already"):
        light.add(gl.framebuffer(made(gl)), srgb(gl))
    light.release()


@pytest.mark.parametrize("scale", [0, 5, 1.5, "2", None])
def test_an_unknown_scale_is_named(gl, scale):
    with pytest.raises(ValueError, match=r"^splat_scale: .* is none of 1, 2, 3, 4$"):
        IndirectLight(gl, bake(), splat_scale=scale)


def test_use_out_of_order_is_named(gl, ready):
    light = IndirectLight(gl, bake())
    with pytest.raises(RuntimeError, match="draw"):
        light.add(ready.target, ready.albedo)
    with pytest.raises(RuntimeError, match="draw"):
        _ = light.indirect
    light.release()
    light.release()
    for use in (
        lambda: light.draw(made(gl, 1), made(gl), CAMERA.view_from_world, projection()),
        lambda: light.add(ready.target, ready.albedo),
        lambda: light.indirect,
    ):
        with pytest.raises(RuntimeError, match="released"):
            use()


def test_a_path_is_no_bake(gl):
    """Which IndirectLight, the look-up, the renderer and points on the CPU say alike."""
    makes = (
        lambda path: IndirectLight(gl, path),
        lambda path: IndirectLookup(gl, path),
        lambda path: DeferredRenderer(gl, scenes.furnace(), path, 8, 8),
        lambda path: gsgi.sample(path, np.zeros((1, 3)), np.ones((1, 3))),
    )
    for make in makes:
        with pytest.raises(TypeError, match=r"^bake: 'room.gsgi' is no Bake: gsgi.read_bake\(path\) reads one"):
            make("room.gsgi")


@pytest.mark.parametrize("box", [(0, 1), ((0, 0), (1, 1)), ((1, 1, 1), (0, 0, 0)), ((0, 0, np.nan), (1, 1, 1))])
def test_corners_of_a_box_that_are_none(gl, box):
    with pytest.raises(ValueError, match=r"^box: .* is not the lowest and the highest corner"):
        IndirectLight(gl, bake(), box=box)
