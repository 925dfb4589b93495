"""Objects that live in an OpenGL context, for tests that nothing is left behind."""

import ctypes

import moderngl

KINDS = "Buffer", "Framebuffer", "Program", "Query", "Renderbuffer", "Sampler", "Texture", "VertexArray"
HIGHEST_NAME = 4096  # Mesa gives out the lowest free names


def alive(ctx: moderngl.Context) -> dict[str, int]:
    """Number of objects of each kind; asks the driver, since moderngl can lose an object without deleting it."""
    return {kind: sum(map(_predicate(ctx, f"glIs{kind}"), range(1, HIGHEST_NAME))) for kind in KINDS}


def _predicate(ctx: moderngl.Context, name: str):
    address = ctx.mglo._context.load_opengl_function(name)
    return ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(address)
