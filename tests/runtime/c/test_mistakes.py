"""What the C library refuses, and that its log names the argument."""

import ctypes
import re

import numpy as np
import pytest
from c_library import (
    DRIVER_ERROR,
    GET_PROC_ADDRESS,
    INVALID_ARGUMENT,
    OK,
    UNSUPPORTED,
    ContextOptions,
    Light,
    LightOptions,
    Messages,
)
from c_light import OVER, SURFACE, WHOLE, drawn
from host import CAMERA, SIZE, projection, projection_for

from gsgi.runtime.gl.host_textures import Encoding


@pytest.mark.parametrize(
    ("message", "view", "clip", "viewport"),
    [
        ("view_from_world: a rigid", np.diag([2.0, 2, 2, 1]), projection(), WHOLE),
        ("view_from_world: a rigid", np.full((4, 4), np.nan), projection(), WHOLE),
        ("clip_from_view: a proj", np.eye(4), np.ones((4, 4)), WHOLE),
        ("clip_from_view: a proj", np.eye(4), projection() * np.nan, WHOLE),
        ("clip_from_view: a proj", np.eye(4), projection() + np.eye(4)[[1, 0, 2, 3]], WHOLE),
        ("clip_from_view: a near", np.eye(4), projection() * np.array([1, 1, 0, 1])[:, None], WHOLE),
        ("clip_from_view: near has the largest", np.eye(4), projection("reversed"), WHOLE),
        ("viewport: ", np.eye(4), projection(), (0, 0, 0, 5)),
        ("viewport: ", np.eye(4), projection(), (-1, 0, 5, 5)),
    ],
)
def test_a_view_that_is_no_camera_is_named(gl, context, message, view, clip, viewport):
    light = Light(context, SURFACE, Encoding("window"))
    assert light.cull(view, clip, viewport) == INVALID_ARGUMENT
    assert re.match(message, context.messages[-1])
    light.destroy()


def test_a_far_pose_in_floats_is_a_camera(context):
    pose = CAMERA.world_from_view.copy()
    pose[:3, 3] += [65536, -131072, 65536]
    light = Light(context, SURFACE, Encoding())
    assert light.cull(np.linalg.inv(pose), projection(), WHOLE) == OK
    light.destroy()


TEXTURES = {  # components, type of moderngl
    "floats": (4, "f4"), "one float": (1, "f4"), "bytes": (4, "f1"), "one byte": (1, "f1"), "integers": (4, "u4"),
    "three bytes": (3, "f1"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("message", "encoding", "depth", "normal"),
    [
        ("depth: integer", Encoding(), "integers", "floats"),
        ("depth: GSGI_DEPTH_LINEAR needs", Encoding(), "one byte", "floats"),
        ("depth: 16 bits", Encoding("window"), "one byte", "floats"),
        ("normal: a depth buffer", Encoding("window"), "depth", "depth"),
        ("normal: needed are three", Encoding(), "one float", "one float"),
        ("normal: needed are three", Encoding(), "one float", "integers"),
        ("normal: the format has no negative", Encoding(normal="signed"), "one float", "bytes"),
        ("normal: its size", Encoding(), "one float", "small"),
        ("viewport: ", Encoding(), "small", "small"),
        ("depth: OpenGL's texture 0", Encoding(), None, "floats"),
        ("normal: OpenGL's texture", Encoding(), "one float", "layers"),
    ],
)
def test_textures_that_cannot_be_right_are_named(gl, context, message, encoding, depth, normal):
    made = {name: gl.texture(SIZE, components, dtype=dtype) for name, (components, dtype) in TEXTURES.items()}
    made |= {"small": gl.texture((8, 8), 4, dtype="f4"), "depth": gl.depth_texture(SIZE)}
    made |= {"layers": gl.texture_array((8, 8, 2), 4)}
    light = Light(context, SURFACE, encoding)
    clip = projection_for(encoding)
    assert light.cull(CAMERA.view_from_world, clip, WHOLE) == OK
    names = [0 if name is None else made[name].glo for name in (depth, normal)]
    assert light.draw(*names)[0] == INVALID_ARGUMENT
    assert context.messages[-1].startswith(message)
    light.destroy()
    for texture_ in made.values():
        texture_.release()


@pytest.mark.parametrize(
    ("message", "how"),
    [("albedo: needed are three", "one float"), ("albedo: the viewport", "small"), ("framebuffer: albedo", "attached")],
)
def test_an_addition_that_cannot_be_right_is_named(gl, context, host, message, how):
    light, textures = Light(context, SURFACE, Encoding()), host.textures(gl, Encoding())
    drawn(gl, light, textures)
    made = {
        "one float": gl.texture(SIZE, 1, dtype="f4"),
        "small": gl.texture((8, 8), 4),
        "attached": gl.texture(SIZE, 4),
    }
    target = gl.framebuffer([gl.texture(SIZE, 4, dtype="f2"), made["attached"]])
    assert light.add(target.glo, made[how].glo) == INVALID_ARGUMENT
    assert context.messages[-1].startswith(message)
    light.destroy()


@pytest.mark.parametrize("how", ["none of that name", "it is not complete", "it holds integers", "it has nothing at"])
def test_a_target_that_cannot_be_right_is_named_and_leaves_no_error(gl, context, host, how):
    light, textures = Light(context, SURFACE, Encoding()), host.textures(gl, Encoding())
    drawn(gl, light, textures)
    load, bare = gl.mglo._context.load_opengl_function, ctypes.c_uint()
    ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_void_p)(load("glGenFramebuffers"))(1, ctypes.byref(bare))
    ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(load("glBindFramebuffer"))(0x8D40, bare)
    gl.error  # noqa: B018
    name = {
        "none of that name": 9999,
        "it is not complete": bare.value,
        "it holds integers": gl.framebuffer([gl.texture(SIZE, 4, dtype="u1")]).glo,
        "it has nothing at": gl.framebuffer(depth_attachment=gl.depth_texture(SIZE)).glo,
    }[how]
    assert light.add(name, gl.texture(SIZE, 4).glo) == INVALID_ARGUMENT
    assert context.messages[-1].startswith("framebuffer: ")
    assert how in context.messages[-1]
    assert gl.error == "GL_NO_ERROR"
    light.destroy()


def test_another_viewport_is_checked_again(gl, context, host):
    light, textures = Light(context, SURFACE, Encoding()), host.textures(gl, Encoding())
    drawn(gl, light, textures)
    assert light.cull(CAMERA.view_from_world, projection(), (8, 0, *SIZE)) == OK
    assert light.draw(*(made.glo for made in textures))[0] == INVALID_ARGUMENT
    assert context.messages[-1].startswith("viewport: ")
    light.destroy()


def test_a_viewport_that_no_driver_has_is_an_error_and_leaves_none(gl, context):
    light = Light(context, OVER, Encoding())
    gl.error  # noqa: B018
    assert light.cull(CAMERA.view_from_world, projection(), (0, 0, 1 << 20, 1)) == OK
    assert light.draw(0, 0)[0] == DRIVER_ERROR
    assert context.messages[-1].startswith("viewport: ")
    assert gl.error == "GL_NO_ERROR"
    assert light.stats().target_bytes == 0
    light.destroy()


def test_options_that_there_are_not_are_named(context):
    for field in ("depth", "normal", "normal_space", "albedo", "rows", "splat_scale"):
        bake_, light = context.library.opened(SURFACE), ctypes.c_void_p()
        options = LightOptions(**{field: 9})
        arguments = context.handle, bake_, ctypes.byref(options), ctypes.byref(light)
        assert context.library.functions.gsgi_light_create(*arguments) == INVALID_ARGUMENT
        assert context.messages[-1].startswith(f"{field}: 9 is none of ")
        context.library.close(bake_)


@pytest.mark.parametrize("corner", [-1.0, np.nan])
def test_a_box_has_a_lowest_and_a_highest_corner(context, corner):
    bake_, light = context.library.opened(SURFACE), ctypes.c_void_p()
    options = LightOptions(box_low=(0, 0, 0), box_high=(1, corner, 1))
    arguments = context.handle, bake_, ctypes.byref(options), ctypes.byref(light)
    assert context.library.functions.gsgi_light_create(*arguments) == INVALID_ARGUMENT
    assert context.messages[-1].startswith("box_low, box_high: ")
    context.library.close(bake_)


def test_a_context_needs_functions(library, gl):
    none = GET_PROC_ADDRESS(lambda name, user: None)
    messages, handle = Messages(), ctypes.c_void_p()
    for load, expected in ((none, UNSUPPORTED), (GET_PROC_ADDRESS(), INVALID_ARGUMENT)):
        options = ContextOptions(callbacks=messages.callbacks, get_proc_address=load)
        assert library.functions.gsgi_context_create(ctypes.byref(options), ctypes.byref(handle)) == expected
    assert messages[0].startswith("get_proc_address: there is no function gl")
    assert not handle
