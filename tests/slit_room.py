"""A room with a slit in its roof, and B in it by paths that end in known light."""

import numpy as np
import scenes

from gsgi.baker.trace.irradiance_cache import IrradianceCache, KnownLight
from gsgi.baker.trace.known_light import known_light
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Filter, Light, Material, Scene

SUN = Light("directional", np.full(3, 20.0), np.zeros(3), np.array([0.3, -1.0, 0.2]) / np.sqrt(1.13))
SPOT = Light(
    "spot", np.full(3, 8.0), np.array([0.3, 0.9, 0.0]), np.array([0.0, -1.0, 0.0]), cos_inner=0.99, cos_outer=0.97
)
LAMP = Light("point", np.full(3, 0.3), np.array([-0.5, 0.5, 0.5]), np.array([0.0, -1.0, 0.0]))
PANE = Material("pane", (0.8, 0.3, 0.3, 0.5), filter=Filter(blends=True), double_sided=True)
CLEAR = Material("clear pane", (0.8, 0.9, 0.9, 0.2), filter=Filter(blends=True, clear=np.inf), double_sided=True)
BOUNCES = 4


def room(*lights: Light, slit: float = 0.1, across: Material | None = None) -> Scene:
    """A box of 2 m with a slit of this width, m, in its roof, and perhaps a sheet `across` it."""
    wall = Material("wall", (0.6, 0.5, 0.4, 1.0), double_sided=True)
    walls = [mesh for mesh in scenes.box() if not (mesh.position[:, 1] == 1).all()]
    for low, high in ((-1, -slit / 2), (slit / 2, 1)):
        walls.append(scenes.quad([(low, 1, -1), (high, 1, -1), (high, 1, 1), (low, 1, 1)]))
    if across:
        walls.append(scenes.floor(1.0, -0.3, 1))
    return Scene(tuple(walls), (wall, across) if across else (wall,), lights=lights)


def inside(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points on the floor and on four walls of the room, with normals inwards."""
    rng = np.random.default_rng(seed)
    normal = np.float32([[0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]])[rng.integers(5, size=count)]
    return np.where(normal != 0, -normal, rng.uniform(-0.99, 0.99, (count, 3))).astype(np.float32), normal


def known(tracer: Tracer, count: int = 20000) -> KnownLight:
    position, normal = inside(count)
    halves = tracer.halves(position, normal, normal, Sampling(32, BOUNCES - 1), 1)
    return known_light(tracer, position, normal, *(half.mean for half in halves), BOUNCES)


def traced(tracer: Tracer, light: IrradianceCache, runs: int = 16) -> np.ndarray:
    """B's brightness (runs, 512) at points of the room, from 32 paths each that end in known light."""
    position, normal = inside(512, 1)
    sampling = Sampling(32, BOUNCES)
    return np.stack(
        [
            tracer.indirect(position, normal, normal, sampling, 7 + run, known=light).mean.mean(axis=1)
            for run in range(runs)
        ]
    )
