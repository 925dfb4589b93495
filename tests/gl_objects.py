"""Objects that live in an OpenGL context, for tests that nothing is left behind."""

import ctypes

import moderngl

KINDS = "Buffer", "Framebuffer", "Program", "Query", "Renderbuffer", "Sampler", "Texture", "VertexArray"
HIGHEST_NAME = 4096  # Mesa gives out the lowest free names


def alive(ctx: moderngl.Context) -> dict[str, int]:
    """Number of objects of each kind; asks the driver, since moderngl can lose an object without deleting it."""
    _function(ctx, "glUseProgram", None)(0)  # a program that is in use lives on after its deletion
    is_alive = {kind: _function(ctx, f"glIs{kind}", ctypes.c_ubyte) for kind in KINDS}
    return {kind: sum(map(is_alive[kind], range(1, HIGHEST_NAME))) for kind in KINDS}


def _function(ctx: moderngl.Context, name: str, result: type | None):
    return ctypes.CFUNCTYPE(result, ctypes.c_uint)(ctx.mglo._context.load_opengl_function(name))
