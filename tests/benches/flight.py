"""A flight through 64 copies of Sponza: frames, bytes in memory, steps of light, and a strip of pictures."""

import hashlib
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image
from repository import ROOT

import gsgi
from gsgi.baker.cache.store import Cache, size_limit
from gsgi.baker.progress import Progress
from gsgi.baker.tasks.request import Request
from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.world.world_baker import WorldBaker
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.display import auto_exposure, encode_srgb, luminance, to_uint8, tone_map
from gsgi.runtime.file import codec
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.manifest import Manifest, encode, sectors_of

from .copies import PITCH, SCENE, SETTINGS, SKY, SUN, square

EDGE, ROW = 8, 3  # copies along an edge of the square; the row of copies that is baked and flown through
ROOM = 3  # sectors that the budget holds
FPS, SPEED = 60, 6.0  # of the flight; m/s
POINTS = 64  # in each sector, at which light is compared between frames
EVERY = 15  # frames of which one is drawn, with a software rasteriser
SIZE, PICTURES = (400, 225), (0, 57, 121, 155, 192)  # px of a frame; m from the start to the pictures of the strip
STRIP = ROOT / "build" / "bench" / "flight.jpg"


def flight() -> list[dict]:
    """A flight through 64 copies of Sponza, whose middle row is baked; draws build/bench/flight.jpg.

    The sectors of the row's eight copies are baked, which takes half an hour, and kept in build/bench/cache. The flight
    has room for three. `update_ms` is the median, the 99th percentile and the most CPU that World.update takes of the
    frame's thread, in each of `frames`. A part of them is `drawn`: `frame_ms` is the median and the 99th percentile of
    their time, `frame_cpu_ms` the median of their CPU, of all threads. `mesh_mb` is what the buffers of meshes take.
    `resident` is the most memory of the world in all frames, bytes, and its budget. `step` is the largest change of
    light between two frames at a fixed point, in 1/255 of a pixel that shows that point's brightest light white.
    """
    if not SCENE.is_file():
        return []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = replace(gsgi.read_scene(square(folder, EDGE)), lights=(SUN,), environment=SKY)
        return [_flown(scene, _baked(scene, folder))]


def _baked(scene: Scene, folder: Path) -> Path:
    """The manifest of the row's sectors."""
    cache = Cache(ROOT / "build" / "bench" / "cache", size_limit())
    baker = WorldBaker(Request(scene, SETTINGS, evaluate=False), PITCH, Progress(), cache)
    boxes, files = baker.division.boxes, []
    assert len(boxes) == EDGE * EDGE
    numbers = range(ROW, EDGE * EDGE, EDGE)  # boxes are counted along z first
    for number in numbers:
        data = baker.sector(number, Progress()).data
        file = f"row.{number}-{hashlib.sha256(data).hexdigest()[:12]}.gsgi"
        (folder / file).write_bytes(data)
        files.append((file, data, codec.decode(data)))
    path, sectors = folder / "row.gsgi.json", sectors_of(files, boxes[list(numbers)])
    path.write_bytes(
        encode(Manifest(path, baker.tracer.fingerprint, files[0][2].effects, baker.division.margin, sectors))
    )
    return path


def _flown(scene: Scene, manifest: Path) -> dict:
    ctx, points, seconds = gsgi.create_context(), _points(scene), (EDGE - 1) * PITCH / SPEED
    count, shown = int(seconds * FPS), {int(along / SPEED * FPS) for along in PICTURES}
    update, frame, cpu, resident, light, strip = [], [], [], [], [], []
    with gsgi.World(manifest) as whole:
        budget = ROOM * max(sector.memory for sector in whole.manifest.sectors)
    with gsgi.World(manifest, budget) as world:
        renderer = gsgi.DeferredRenderer(ctx, scene, world, *SIZE)
        world.settle(_camera(0).position)
        meshes = {b for batch in renderer.geometry.batches for b in (batch.indices, *batch.attributes.values())}
        mesh_bytes = sum(buffer.size for buffer in meshes)
        renderer.render(_camera(0))  # fills the shadow map, and compiles
        for number in range(count):
            camera, began = _camera(number / FPS), time.perf_counter()
            thread = time.thread_time()
            world.update(camera.position, 1 / FPS)
            update.append(1e3 * (time.thread_time() - thread))
            resident.append(world.memory)
            light.append(luminance(world.sample(*points)))
            if number % EVERY == 0 or number in shown:
                start, process = time.perf_counter(), time.process_time()
                renderer.render(camera)
                ctx.finish()
                frame.append(1e3 * (time.perf_counter() - start))
                cpu.append(1e3 * (time.process_time() - process))
            if number in shown:
                drawn = renderer.read("final")
                strip.append(to_uint8(tone_map(drawn, auto_exposure(drawn))))
            time.sleep(max(1 / FPS - (time.perf_counter() - began), 0))
        renderer.release()
    ctx.release()
    STRIP.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(strip, axis=1)).save(STRIP, quality=85)
    return {
        "frames": count, "update_ms": _spread(update, 50, 99, 100), "drawn": len(frame),
        "frame_ms": _spread(frame, 50, 99), "frame_cpu_ms": _spread(cpu, 50), "mesh_mb": round(mesh_bytes / 1e6, 1),
        "resident": f"{max(resident)} of {budget}", "step": round(step_of(np.array(light)), 2), "file": STRIP.name,
    }  # fmt: skip


def _camera(seconds: float) -> Camera:
    """Where the flight is: along the middle of the row, up and down, and looking around."""
    along = seconds * SPEED
    middle = np.array([-(EDGE - 1) / 2 * PITCH + along, 0, (ROW - (EDGE - 1) / 2) * PITCH])
    turn = 0.7 * np.sin(2 * np.pi * along / 45)
    eye = middle + np.array([0, 5 - 2.5 * np.cos(2 * np.pi * along / 70), 0])
    ahead = np.array([np.cos(turn), -0.05, np.sin(turn)])
    return look_at(eye, eye + ahead, np.eye(3)[1], 1.0, 0.05)


def _points(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Points on surfaces of the row's copies, with their normals."""
    places = sorted({tuple(mesh.world_from_shape[:3, 3]) for mesh in scene.meshes})
    row = np.array(places)[ROW::EDGE]
    first = [mesh for mesh in scene.meshes if np.array_equal(mesh.world_from_shape[:3, 3], row[0])]
    drawn = Triangles(replace(scene, meshes=tuple(first))).draw(POINTS, np.random.default_rng(0))
    position = np.concatenate([drawn.position + place - row[0] for place in row])
    return position, np.tile(drawn.normal, (EDGE, 1))


def step_of(light: np.ndarray) -> float:
    """The largest step between frames of luminance (T, N) at points, each relative to its own brightest frame."""
    lit = light[:, light.max(axis=0) > 0]
    return float(255 * np.abs(np.diff(encode_srgb(lit / lit.max(axis=0)), axis=0)).max())


def _spread(values: list[float], *ranks: int) -> str:
    return ", ".join(f"{value:.2f}" for value in np.percentile(values, ranks))
