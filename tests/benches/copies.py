"""Worlds of copies of one scene: what a sector costs and takes, whatever stands beside it."""

import json
import shutil
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from repository import SHARED

import gsgi
from gsgi.baker.cache.store import Cache
from gsgi.baker.progress import Progress
from gsgi.baker.report import peak_memory
from gsgi.baker.settings import Settings
from gsgi.baker.tasks.request import Request
from gsgi.baker.world.world_baker import WorldBaker
from gsgi.runtime.scene import Environment, Light

SCENE = SHARED / "sponza_crytek" / "sponza.gltf"
PITCH = 32.0  # m; the scene is 30 m long
EDGES = 1, 2, 4, 8  # copies along an edge of a square
SETTINGS = Settings(quality="draft", views=96, samples=256)
SUN = Light("directional", np.full(3, 10.0), np.zeros(3), np.array([0.36, -0.8, 0.48]))
SKY = Environment(np.ones((1, 1, 3), np.float32))


def copies() -> list[dict]:
    """Cost and memory of sectors in worlds of 1, 4, 16 and 64 copies of Sponza, two sectors of each.

    The copies stand in a square and share meshes. A sector of 32 m holds about one: the first is in a corner, the other
    in the middle, among eight. `before_s` are the CPU seconds of what all sectors share, `sector_s` those of the two;
    `memory_mb` is the peak of the process.
    """
    return [_row(edge) for edge in EDGES] if SCENE.is_file() else []


def _row(edge: int) -> dict:
    """The row of a world, which a process of its own bakes."""
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(1, get_context("spawn")) as process:
        return process.submit(_baked, square(Path(folder), edge), edge).result()


def square(folder: Path, edge: int) -> Path:
    """A glTF file in `folder` with a square of copies of the scene, as nodes that share meshes."""
    document = json.loads(SCENE.read_text())
    for kind in ("buffers", "images"):
        for entry in document[kind]:
            (folder / entry["uri"]).parent.mkdir(exist_ok=True)
            shutil.copy(SCENE.parent / entry["uri"], folder / entry["uri"])
    nodes = document["nodes"]
    assert [len(nodes), document["scenes"][0]["nodes"]] == [1, [0]], "a scene of one node"
    places = (PITCH * (np.array([i, 0, k]) - [(edge - 1) / 2, 0, (edge - 1) / 2]) for i, k in np.ndindex(edge, edge))
    document["nodes"] = [nodes[0] | {"translation": place.tolist()} for place in places]
    document["scenes"][0]["nodes"] = list(range(edge * edge))
    path = folder / "copies.gltf"
    path.write_text(json.dumps(document))
    return path


def _baked(path: Path, edge: int) -> dict:
    scene = replace(gsgi.read_scene(path), lights=(SUN,), environment=SKY)
    row = {"copies": edge * edge, "triangles": sum(len(mesh.triangle) for mesh in scene.meshes)}
    with tempfile.TemporaryDirectory() as cache:
        world = WorldBaker(Request(scene, SETTINGS, evaluate=False), PITCH, Progress(), Cache(Path(cache)))
        assert len(world.division.boxes) == edge * edge
        # What all sectors share is made before the first.
        assert world.tracer.fingerprint
        assert world.tracer.tracer
        row["before_s"] = round(time.process_time(), 1)
        numbers = dict.fromkeys((0, edge // 2 * (edge + 1)))
        took = [world.sector(number, Progress()).report["cpu_seconds"] for number in numbers]
    return row | {"sector_s": ", ".join(f"{each:.1f}" for each in took), "memory_mb": peak_memory() >> 20}
