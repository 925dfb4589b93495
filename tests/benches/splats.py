"""Milliseconds of indirect light in a frame: both operators, `surface` at each splat scale."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scenes

from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend
from gsgi.runtime.scene import Scene

COUNTS = 5_000, 20_000, 50_000
SIZE = 1280, 720
ROUNDS = 12


def splats() -> list[dict]:
    """Fastest of 12 draws at 1280 x 720, with sorting and culling, and the error of B against full resolution."""
    from gsgi.runtime.gl.context import create_context
    from gsgi.runtime.gl.gbuffer import GBuffer
    from gsgi.runtime.gl.geometry import Geometry
    from gsgi.runtime.gl.indirect_light import IndirectLight
    from gsgi.runtime.gl.surface_light import SCALES
    from gsgi.runtime.gl.view import View

    ctx, rows = create_context(), []
    gbuffer = GBuffer(ctx, Geometry(ctx, room()), SIZE)
    camera = scenes.inside_camera()
    gbuffer.draw(camera)
    frame = View.of_camera(camera, SIZE), gbuffer.depth, gbuffer.interpolated
    for count in COUNTS:
        fine = on_surfaces(count)
        bake = Bake(fine, SurfaceBlend(), coarse=grid())
        passes = {("over", 1): IndirectLight(ctx, Bake(fine, OverBlend(near=0.05)))}
        passes |= {("surface", scale): IndirectLight(ctx, bake, splat_scale=scale) for scale in SCALES}
        times = fastest({key: lambda p=p: (p.draw_view(*frame), ctx.finish()) for key, p in passes.items()})
        light = {key: np.frombuffer(p.indirect.read(), np.float32) for key, p in passes.items()}
        full = light["surface", 1]
        for (operator, scale), p in passes.items():
            row = {"gaussians": count, "operator": operator, "splat_scale": scale}
            row |= {"ms": round(1e3 * times[operator, scale], 1)}
            row |= {"of_over": round(times[operator, scale] / times["over", 1], 2)}
            if operator == "surface":
                error = np.abs(light[operator, scale] - full) / full.mean()
                row |= {"mean_error": f"{error.mean():.5f}", "p99_error": f"{np.quantile(error, 0.99):.5f}"}
            rows.append(row)
            p.release()
    return rows


def fastest(calls: dict[tuple, Callable]) -> dict[tuple, float]:
    """Seconds of each call, fastest of ROUNDS. Calls are interleaved, so that all see the same load of the machine."""
    seconds = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for key, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[key] = min(seconds[key], time.perf_counter() - start)
    return seconds


def room() -> Scene:
    """A box with a block on its floor."""
    block = [replace(m, position=m.position - np.float32([0, 0.7, 0.4])) for m in scenes.box(0.3, inward=False)]
    return Scene((*scenes.box(), *block), (scenes.WHITE,))


def on_surfaces(count: int) -> Gaussians:
    """Flat Gaussians with smooth light, evenly distributed on the room's surfaces."""
    from gsgi.baker.over.initialise import from_surface
    from gsgi.baker.views.surface_points import Triangles

    points = Triangles(room()).sample(count, seed=0)
    light = 0.5 + 0.3 * np.sin(2 * points.position + points.position[:, ::-1]) + 0.1 * points.normal
    return from_surface(points.position, points.normal, light.astype(np.float32), sh_degree=0)


def grid(edge: int = 4) -> Gaussians:
    """A coarse level of SH degree 2: round Gaussians on a grid, each reaching past its neighbours."""
    line = (np.arange(edge) + 0.5) * (2 / edge) - 1
    position = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3).astype(np.float32)
    count = len(position)
    sh = np.zeros((count, 9, 3), np.float32)
    sh[:, 0] = 2
    rotation = np.tile(np.float32([0, 0, 0, 1]), (count, 1))
    scale = np.full((count, 3), 1 / edge, np.float32)
    return Gaussians(position, rotation, scale, np.ones(count, np.float32), sh)
