"""Paths per second and kernels of the path tracer, on lit scenes."""

import time
from dataclasses import replace
from functools import partial

import numpy as np
from repository import SCENES, SHARED

from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.scene import Environment, Scene

WHITE_SKY = Environment(np.ones((1, 1, 3), np.float32))

SIZE, SAMPLES, DEPTH, RUNS = 256, 64, 8, 3


def scenes() -> dict[str, Scene]:
    """Scenes by name; those of the shared folder only if it exists."""
    files = {"cornell": SCENES / "cornell.glb", "two_rooms": SCENES / "two_rooms.glb"}
    files |= {path.stem: path for path in sorted(SHARED.glob("*/*.gltf")) if path.stem in LIT}
    found = {name: read_gltf(path) for name, path in files.items()}
    if "sponza_sun" in found:
        found["sponza_sun, white sky"] = replace(found["sponza_sun"], environment=WHITE_SKY)
    return found


LIT = {"cornell_mcguire", "modern_hall", "breakfast_room_sun", "sponza_sun"}


def trace() -> list[dict]:
    """Paths per second from the points that a camera sees, best of three runs, and the number of compiled kernels."""
    import drjit as dr

    rows = []
    for name, scene in scenes().items():
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            tracer = Tracer(scene)
            points = tracer.surface(camera(scene), SIZE, SIZE).points()
            dr.kernel_history_clear()
            seconds = min(seconds_of(partial(tracer.indirect, *points, Sampling(SAMPLES, DEPTH)), RUNS + 1))
            kernels = {k["hash"] for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT}
        paths = len(points[0]) * SAMPLES
        triangles = sum(len(mesh.triangle) for mesh in scene.meshes)
        rows.append({"scene": name, "triangles": triangles, "textures": len(scene.textures), "depth": DEPTH,
                     "Mpaths_per_s": round(paths / seconds / 1e6, 2), "kernels": len(kernels)})  # fmt: skip
    return rows


def camera(scene: Scene):
    """The scene's first camera, or one placed in it."""
    from gsgi.baker.views.placement import place
    from gsgi.baker.views.surface_points import Triangles

    if scene.cameras:
        return next(iter(scene.cameras.values()))
    return next(iter(place(Triangles(scene), {}, SIZE, seed=0, count=1).fitted.values()))


def seconds_of(run, times: int) -> list[float]:
    """Seconds of calls with the seeds 0, 1, ..., without the first one, which compiles."""
    seconds = []
    for seed in range(times):
        start = time.perf_counter()
        run(seed)
        seconds.append(time.perf_counter() - start)
    return seconds[1:]
