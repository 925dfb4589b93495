"""A world of copies of one scene: what each sector costs, and a flight through what was baked."""

import json
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from repository import SCENES

import gsgi
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.world.boxes import FAR

SCENE, PITCH = "two_rooms", 8.5  # m; the scene is 8 m long
COPIES = 1, 3, 7
FLAGS = "--quality", "draft", "--views", "96", "--samples", "256", "--no-evaluate"
POINTS, ACROSS = 20_000, 1e-3  # on each border; m, between the two sides
FPS, SPEED, SIZE = 60, 6.0, (320, 180)  # m/s of the flight; px
FADE = 0.5  # s: a flight this fast would outrun the default


def world() -> list[dict]:
    """Cost per sector, memory, seams, and frames of a flight, for worlds of 1, 3 and 7 copies of two rooms.

    Borders cut through rooms: there is one sector more than copies. `sector_s` are the least and the most CPU seconds
    of a sector; `memory_mb` the peak of the bake's process. `seam` is the largest change of B over 1 mm along surfaces,
    in the strips where sectors meet, and `elsewhere` in others as wide, in 1/255 of the mean B. The flight has room for
    two sectors. `update_ms` is the median and the most that World.update takes of the frame's thread, `frame_ms` the
    median and the most of update and drawing together, with a software rasteriser.
    """
    with tempfile.TemporaryDirectory() as folder:
        return [_row(Path(folder), copies) for copies in COPIES]


def _row(folder: Path, copies: int) -> dict:
    scene = folder / f"rooms{copies}.glb"
    scene.write_bytes(repeated((SCENES / f"{SCENE}.glb").read_bytes(), copies))
    manifest, size = folder / f"rooms{copies}.gsgi.json", 1.001 * PITCH * copies / (copies + 1)
    command = [sys.executable, "-m", "gsgi.baker", "bake", str(scene), "-o", str(manifest), "--sectors", str(size)]
    run = subprocess.run(
        [*command, *FLAGS, "--json", "--cache", str(folder / "cache")], check=True, capture_output=True, text=True
    )
    report = json.loads(run.stdout)
    took = [sector["cpu_seconds"] for sector in report["sectors"]]
    row = {
        "copies": copies, "triangles": sum(len(mesh.triangle) for mesh in gsgi.read_scene(scene).meshes),
        "sectors": len(took), "sector_s": f"{min(took):.1f} to {max(took):.1f}", "mean_s": round(np.mean(took), 1),
        "memory_mb": report["peak_memory"] >> 20, "bytes": report["bytes"], "gaussians": report["gaussians"],
    }  # fmt: skip
    return row | _seams(scene, manifest) | _flight(scene, manifest)


def repeated(glb: bytes, copies: int) -> bytes:
    """A .glb file whose nodes are there so many times, PITCH m apart along x, and share their meshes."""
    length = struct.unpack("<I", glb[12:16])[0]
    document, rest = json.loads(glb[20 : 20 + length]), glb[20 + length :]
    nodes, roots = document["nodes"], document["scenes"][0]["nodes"]
    own = len(nodes)
    document["scenes"][0]["nodes"] = []
    every = [
        {**node, "children": [child + copy * own for child in node["children"]]} if "children" in node else dict(node)
        for copy in range(copies)
        for node in nodes
    ]
    for copy in range(copies):
        document["scenes"][0]["nodes"].append(len(every))
        every.append({"translation": [copy * PITCH, 0, 0], "children": [root + copy * own for root in roots]})
    document["nodes"] = every
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return (
        struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + rest
    )


def _seams(scene: Path, manifest: Path) -> dict:
    """The largest steps of B over 1 mm along surfaces, at borders and in strips as wide that are none."""
    with gsgi.World(manifest) as world:
        world.settle()
        triangles, margin = Triangles(gsgi.read_scene(scene)), world.manifest.margin
        borders = {float(x) for x in world.windows[:, :, 0].ravel() if abs(x) < FAR}
        apart = 3 * margin, -3 * margin
        mean = world.sample(*_points(triangles, -FAR, FAR)).mean()
        steps = [
            max(_step(world, *_points(triangles, x + shift - margin, x + shift + margin)) for x in borders)
            for shift in (0.0, *apart)
        ]
    return {"seam": round(255 * steps[0] / mean, 3), "elsewhere": round(255 * max(steps[1:]) / mean, 3)}


def _points(triangles: Triangles, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on surfaces between planes at `low` and `high` m along x, with their normals."""
    strip = triangles.within(np.array([[low, -FAR, -FAR], [high, FAR, FAR]]))
    drawn = strip.draw(POINTS, np.random.default_rng(0))
    return drawn.position.astype(float), drawn.normal


def _step(world, position: np.ndarray, normal: np.ndarray) -> float:
    """The largest change of B between points a step apart, on surfaces that go on along x."""
    along = np.abs(normal[:, 0]) < 0.1
    shift = ACROSS / 2 * np.eye(3)[0]
    left, right = (world.sample(position[along] + sign * shift, normal[along]) for sign in (-1, 1))
    return float(np.abs(right - left).max())


def _flight(scene_file: Path, manifest: Path) -> dict:
    """Frames from one end to the other, in time with the clock."""
    scene, ctx = gsgi.read_scene(scene_file), gsgi.create_context()
    with gsgi.World(manifest) as whole:
        budget = sum(sorted(sector.memory for sector in whole.manifest.sectors)[-2:])
        low, high = whole.manifest.boxes[:, 0].min(axis=0), whole.manifest.boxes[:, 1].max(axis=0)
    update, frame, memory = [], [], 0
    with gsgi.World(manifest, budget, FADE) as world:
        renderer, camera = gsgi.DeferredRenderer(ctx, scene, world, *SIZE), next(iter(scene.cameras.values()))
        start = np.array([low[0] + 1, 1.5, (low[2] + high[2]) / 2])
        world.settle(start)
        for step in range(int((high[0] - low[0] - 2) / SPEED * FPS)):
            began, thread = time.perf_counter(), time.thread_time()
            pose = camera.world_from_view.copy()
            pose[:3, 3] = start + step * SPEED / FPS * np.eye(3)[0]
            world.update(pose[:3, 3], 1 / FPS)
            update.append(1e3 * (time.thread_time() - thread))
            renderer.render(replace(camera, world_from_view=pose))
            ctx.finish()
            frame.append(1e3 * (time.perf_counter() - began))
            memory = max(memory, world.memory)
            time.sleep(max(1 / FPS - (time.perf_counter() - began), 0))
        renderer.release()
    ctx.release()
    return {
        "frames": len(frame), "update_ms": f"{np.median(update):.2f}, {max(update):.2f}",
        "frame_ms": f"{np.median(frame):.0f}, {max(frame):.0f}", "resident": f"{memory} of {budget}",
    }  # fmt: skip
