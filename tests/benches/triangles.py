"""Cost against the number of triangles: bumpy ground under a white sky, each number in a process of its own."""

import json
import resource
import subprocess
import sys
import time

import numpy as np

from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Environment, Material, Mesh, Scene

COUNTS = 10_000, 100_000, 1_000_000, 5_000_000


def triangles() -> list[dict]:
    """Seconds of building, placing 64 views and tracing, and peak memory, from 10 thousand to 5 million triangles."""
    rows = []
    for count in COUNTS:
        run = subprocess.run([sys.executable, __file__, str(count)], stdout=subprocess.PIPE, check=True)
        rows.append(json.loads(run.stdout))
    for row in rows:
        row["times_cost"] = round(row["all_s"] / rows[0]["all_s"], 2)
        row["times_triangles"] = round(row["triangles"] / rows[0]["triangles"], 1)
    return rows


def ground(count: int) -> Scene:
    """A bumpy ground of about `count` triangles under a white sky, 4 m across."""
    edge = int(np.sqrt(count / 2))
    x, z = np.meshgrid(*[np.linspace(-2, 2, edge + 1)] * 2)
    y = 0.15 * np.sin(7 * x) * np.cos(5 * z) + 0.02 * np.sin(61 * x + 40 * z)
    slope_x = 1.05 * np.cos(7 * x) * np.cos(5 * z) + 1.22 * np.cos(61 * x + 40 * z)
    slope_z = -0.75 * np.sin(7 * x) * np.sin(5 * z) + 0.8 * np.cos(61 * x + 40 * z)
    position, normal = (
        np.stack(axes, axis=-1).reshape(-1, 3).astype(np.float32)
        for axes in ((x, y, z), (-slope_x, np.ones_like(x), -slope_z))
    )
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    corner = (np.arange(edge)[:, None] * (edge + 1) + np.arange(edge)).ravel().astype(np.uint32)
    right, below = corner + np.uint32(1), corner + np.uint32(edge + 1)
    triangle = np.concatenate([np.stack(t, axis=1) for t in ((corner, below, right), (right, below, below + 1))])
    grey = Material("ground", (0.5, 0.5, 0.5, 1.0))
    floor = Mesh(position, normal, np.zeros((len(position), 0, 2), np.float32), triangle, 0)
    return Scene((floor,), (grey,), environment=Environment(np.ones((1, 1, 3), np.float32)))


def measure(count: int) -> dict:
    """Build the tracer, place views, trace, and return the row."""
    import open3d  # noqa: F401  (imported here, so that its seconds do not count)

    from gsgi.baker.trace.mitsuba_scene import load_mitsuba
    from gsgi.baker.trace.tracer import Sampling, Tracer
    from gsgi.baker.views.placement import place
    from gsgi.baker.views.surface_points import Triangles

    load_mitsuba()
    scene = ground(count)
    camera = look_at(np.array([0.0, 2.5, 2.5]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    clock = [time.perf_counter()]

    def lap() -> float:
        clock.append(time.perf_counter())
        return round(clock[-1] - clock[-2], 2)

    tracer = Tracer(scene)
    points = tracer.surface(camera, 192, 192).points()
    row = {"triangles": sum(len(mesh.triangle) for mesh in scene.meshes), "tracer_s": lap()}
    placement = place(Triangles(scene), {}, 192, seed=0, count=64)
    row |= {"views_s": lap(), "views": len(placement.fitted)}
    tracer.indirect(*points, Sampling(32, 8), seed=0)
    lap()  # compiles
    tracer.indirect(*points, Sampling(64, 8), seed=1)
    row["trace_s"] = lap()
    row["Mpaths_per_s"] = round(len(points[0]) * 64 / max(row["trace_s"], 1e-3) / 1e6, 2)
    row["all_s"] = round(clock[-1] - clock[0], 2)
    row["peak_GB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9, 2)
    return row


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]))))
