"""The same view by the C library's light pass and by IndirectLight, in one context."""

import ctypes

import numpy as np
from c_library import OK, Light
from host import CAMERA, SIZE, bake, call, projection

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.host_textures import OURS
from gsgi.runtime.gl.indirect_light import IndirectLight

SURFACE = codec.encode(bake())
OVER = codec.encode(Bake(bake().gaussians, OverBlend(near=0.05)))
WHOLE = (0, 0, *SIZE)


def of_python(
    gl, data, textures, view, clip, viewport=WHOLE, encoding=OURS, splat_scale=2, weights=None, mapped=None, **how
) -> np.ndarray:
    """What IndirectLight draws: (H, W, 4) float32, as integers."""
    light = IndirectLight(gl, codec.decode(data), encoding, splat_scale, **how)
    light.weights = weights or {}
    made = light.draw(*textures, np.float32(view), np.float32(clip), viewport, mapped)
    found = texels(made.glo, gl, made.size)
    light.release()
    return found


def of_c(gl, context, data, textures, view, clip, viewport=WHOLE, encoding=OURS, splat_scale=2, mapped=None, **how):
    """The same by the C library, which makes no errors of OpenGL."""
    gl.error  # noqa: B018  reading it clears what Python's pass left
    light = Light(context, data, encoding, splat_scale, **how)
    assert light.result == OK, context.messages
    assert light.cull(view, clip, viewport) == OK, context.messages
    result, name = light.draw(*(made.glo for made in (*textures, *([mapped] if mapped else []))))
    assert result == OK, context.messages
    found = texels(name, gl, viewport[2:])
    light.destroy()
    assert (gl.error, context.messages) == ("GL_NO_ERROR", [])
    return found


def texels(name: int, gl, size) -> np.ndarray:
    """A texture of halves or floats: (H, W, 4) float32, as integers."""
    made = gl.external_texture(name, tuple(size), 4, 0, "f4")
    return np.frombuffer(made.read(), np.uint32).reshape(size[1], size[0], 4)


def check_same(gl, context, *arguments, **how) -> None:
    expected, found = of_python(gl, *arguments, **how), of_c(gl, context, *arguments, **how)
    lit = expected[..., :3].any(axis=-1)
    assert lit.mean() > 0.2
    if "llvmpipe" in gl.info["GL_RENDERER"]:
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_allclose(found.view(np.float32), expected.view(np.float32), atol=2**-9, rtol=2**-9)


def drawn(gl, light: Light, textures, clip=None) -> np.ndarray:
    """What the light draws of a whole host: (H, W, 4) float32, as integers."""
    assert light.cull(CAMERA.view_from_world, projection() if clip is None else clip, WHOLE) == OK
    result, name = light.draw(*(made.glo for made in textures))
    assert result == OK, light.context.messages
    return texels(name, gl, SIZE)


def read_floats(gl, name: int, size) -> np.ndarray:
    """The texture (H, W, 4) float32: OpenGL ES reads framebuffers alone."""
    target, found = (ctypes.c_uint * 1)(), np.empty((size[1], size[0], 4), np.float32)
    call(gl, "GenFramebuffers", 1, target)
    for function, *arguments in (
        ("BindFramebuffer", 0x8D40, target[0]), ("FramebufferTexture2D", 0x8D40, 0x8CE0, 0x0DE1, name, 0),
        ("BindBuffer", 0x88EB, 0), ("ReadPixels", 0, 0, *size, 0x1908, 0x1406, found.ctypes.data_as(ctypes.c_void_p)),
    ):  # fmt: skip
        call(gl, function, *arguments)
    return found
