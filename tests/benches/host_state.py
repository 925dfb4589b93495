"""Milliseconds that IndirectLight takes to find and restore a host's OpenGL state."""

import numpy as np

from benches.splats import fastest, grid, on_surfaces

SIZE = 8, 8  # px; hardly anything is drawn


def host_state() -> list[dict]:
    """Fastest draw() and add() of a frame of 8 x 8 px, with and without `keep_state`."""
    from gsgi.runtime.camera import look_at
    from gsgi.runtime.gaussians import Bake, SurfaceBlend
    from gsgi.runtime.gl.context import create_context
    from gsgi.runtime.gl.indirect_light import IndirectLight

    ctx = create_context()
    depth, normal, albedo = ctx.texture(SIZE, 1, dtype="f4"), *(ctx.texture(SIZE, 4, dtype="f4") for _ in range(2))
    target = ctx.framebuffer(ctx.texture(SIZE, 4, dtype="f2"))
    camera = look_at(np.array([0.0, 0.0, 9.0]), np.array([0.0, 0.0, 10.0]), np.array([0.0, 1.0, 0.0]), 0.8, 0.1)
    matrices = camera.view_from_world, camera.clip_from_view(1.0)
    bake = Bake(on_surfaces(100), SurfaceBlend(), coarse=grid())
    lights = {(keep,): IndirectLight(ctx, bake, keep_state=keep) for keep in (True, False)}

    def frame(light: IndirectLight) -> None:
        light.draw(depth, normal, *matrices)
        light.add(target, albedo)
        ctx.finish()

    times = fastest({key: lambda light=light: frame(light) for key, light in lights.items()})
    return [{"keep_state": keep, "ms": round(1e3 * seconds, 2)} for (keep,), seconds in times.items()]
