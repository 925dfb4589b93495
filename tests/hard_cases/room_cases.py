"""Rooms whose light is hard to bake, in the tracer, in bakes of both operators, and in frames."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import scenes

from gsgi.runtime.camera import look_at
from gsgi.runtime.errors import SceneError
from gsgi.runtime.file.levels import FINE_STEPS
from gsgi.runtime.scene import Material, Mesh, Scene

from . import light
from .case import Case, Tolerance
from .rooms import EYE, HERE, KnownLight, Place, Room, SameLight, on_walls

GAUSSIAN = Tolerance(
    0.02, "one standard error of a Gaussian's light: 43 samples of 64 paths, whose light deviates by less than its mean"
)
FRAME = Tolerance(0.025, "that of the bake, and half floats")
LOUD = Tolerance(
    0.04, "the noise s of 32 paths lowers a mean under the tone curve by s^2 / 2 = 1.6 %, and as much again"
)
SEEDS = Tolerance(1.5, "another seed makes a difference of 1, and three standard errors of 48 Gaussians are half of it")
BLACK = Tolerance(0, "no light is no light")
EDGES = Tolerance(
    0.01, "1e-6 of the light behind it: a path in 1e6 meets an edge to its rounding, and goes on behind it"
)
NOISY = Tolerance(
    0.12, "32 paths, whose light deviates by as much as its mean, in each of 3 pixels of a Gaussian; LOUD"
)
KNOWN = {"bake": GAUSSIAN, "frame": FRAME}
BOTH = KNOWN | {"frame of over": LOUD}
SAME = {"tracer": SEEDS, "bake": SEEDS, "frame": SEEDS}
OVER_THE_SHEET = 0.1, 0.5, -0.1  # the sheet is between it and EYE
AWAY = np.array([1.0, -0.7, 0.4])
LAMP = Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(9.0, 8.0, 6.0))
RED = Material("red", (0.6, 0.1, 0.1, 1.0))


def furnace(albedo: float = 0.5, emission: float = 1.0, change: Callable[[Scene], Scene] | None = None, **how) -> Room:
    scene = scenes.furnace(albedo, emission)
    return Room(change(scene) if change else scene, bounces=64 if albedo < 0.9 else 1024, **how)


def known(name: str, holds: str, room: Callable[[], Room], b: float, tolerances=None, slow: bool = True) -> Case:
    return Case("Light", name, holds, lambda: KnownLight(room, b), tolerances or KNOWN, slow=slow)


def unchanged(
    name: str, place: Place = HERE, change: Callable[[Scene], Scene] | None = None, slow: bool = True
) -> Case:
    """A case of the room of `original`, somewhere else or changed."""

    def room() -> Room:
        return Room(change(original().scene) if change else original().scene, place)

    holds = "B is as near to the original's as with another seed"
    return Case("Invariance", f"a room, {name}", holds, lambda: SameLight(original, cache(room)), SAME, slow=slow)


@cache
def original() -> Room:
    """A grey room with one red wall, a lamp under the ceiling, and a block that throws a shadow."""
    walls = scenes.box()
    walls[0] = replace(walls[0], material=1)
    panel = scenes.floor(0.3, 0.9, 2)
    panel = replace(panel, triangle=panel.triangle[:, ::-1].copy(), normal=-panel.normal)
    block = [moved(mesh, (0.35, -0.6, -0.3)) for mesh in scenes.box(0.25, inward=False)]
    return Room(Scene((*walls, panel, *block), (scenes.WHITE, RED, LAMP)))


def moved(mesh: Mesh, offset) -> Mesh:
    return replace(mesh, position=mesh.position + np.float32(offset))


def scaled(factor: float) -> Place:
    return Place(factor * np.eye(3), np.zeros(3))


def merged(scene: Scene) -> Scene:
    """A mesh for each material."""
    parts = [tuple(m for m in scene.meshes if m.material == k) for k in range(len(scene.materials))]
    return replace(scene, meshes=tuple(light.merged(replace(scene, meshes=part)).meshes[0] for part in parts))


def metal_floor(scene: Scene) -> Scene:
    """The floor of metal with the walls' colour, which reflects as rough metal does."""
    metal = replace(scene.materials[0], metallic=1.0)
    meshes = [replace(mesh, material=1 if mesh.normal[0, 1] > 0.5 else 0) for mesh in scene.meshes]
    return replace(scene, meshes=tuple(meshes), materials=(*scene.materials, metal))


def with_meshes(*meshes: Mesh) -> Callable[[Scene], Scene]:
    return light.with_meshes(*meshes)


def dark_room() -> Room:
    """Closed, within walls that shine, 1 mm away."""
    return Room(light.shell(1.001))


def dim_beside_bright() -> Room:
    """Two closed rooms side by side, 0.3 m apart, of B = 0.2 and 50; the light of the dim one is looked at."""
    materials = [Material("wall", (0.5, 0.5, 0.5, 1.0), emission=(radiance,) * 3) for radiance in (0.1, 25.0)]
    gap = np.float32([2.3, 0, 0])
    rooms = [moved(replace(mesh, material=k), k * gap) for k in (0, 1) for mesh in scenes.box()]
    eyes = (0.1, 0.05, -0.1), (2.4, 0.05, -0.1)
    return Room(Scene(tuple(rooms), tuple(materials)), points=on_walls(192), eyes=eyes)


def from_within() -> Room:
    """Seen by a camera that stands in a block, whose backs it does not see."""
    block = scenes.box(0.2, inward=False)
    eye = np.array([0.05, 0.0, 0.02])
    camera = look_at(eye, np.array([0.3, -0.4, -1.0]), np.array([0.0, 1.0, 0.0]), 1.4, 0.01)
    return furnace(change=with_meshes(*block), cameras=(camera,), eyes=((0.6, 0.5, 0.6), (-0.6, -0.5, -0.6)))


def edge_on() -> Room:
    """Seen by a camera whose eye is in the plane of the floor."""
    camera = look_at(np.array([0.5, -1.0, 0.8]), np.array([0.0, -1.0, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)
    return furnace(cameras=(camera,))


def house_on_ground(half: float) -> Callable[[Scene], Scene]:
    return with_meshes(scenes.floor(half, -1.5))


EVERYWHERE = "B = L / (1 - r) everywhere"
LIT = "B is 2"

LIGHT = [
    known("a bake of a furnace of albedo 0", EVERYWHERE, lambda: furnace(0.0), 1, BOTH),
    known("a bake of a furnace of albedo 0.5", EVERYWHERE, furnace, 2, BOTH, slow=False),
    known("a bake of a furnace of albedo 0.99", EVERYWHERE, lambda: furnace(0.99), 100,
          KNOWN | {"frame of over": NOISY}),
    known("a bake of a furnace of radiance 1e-6", EVERYWHERE, lambda: furnace(0.5, 1e-6), 2e-6, dict.fromkeys(
        KNOWN, Tolerance(0.05, "a step of half floats is 6e-8, of which half is 1.5 %, and one of the file 4.4 %"))),
    known("a bake of a furnace of radiance 1e6", "a file holds light of less than 2^16", lambda: furnace(0.5, 1e6),
          2 ** (16 - 1 / FINE_STEPS["light_steps"])),
    known("a bake of a closed room of albedo 1 without light", "it is black", lambda: Room(light.NO_LIGHT), 0,
          dict.fromkeys(("bake", "frame", "frame of over"), BLACK)),
    known("a bake of light behind a 1 mm wall", "none comes through", dark_room, 0,
          dict.fromkeys(("bake", "frame", "frame of over"), EDGES), slow=False),
    known("a bake of slivers and triangles without area", LIT,
          lambda: furnace(change=with_meshes(light.slivers())), 2, BOTH),
    known("a bake of walls that stand there twice", LIT,
          lambda: furnace(change=light.lying_on_it(back_to_back=False, other_triangles=False, material=0)), 2, BOTH),
    known("a bake of sheets of two faces back to back", LIT,
          lambda: furnace(change=light.lying_on_it(back_to_back=True, other_triangles=True, material=1)), 2, BOTH,
          slow=False),
    known("a bake of normals that face away", LIT, lambda: furnace(change=light.inside_out), 2),
    known("a bake of a two-sided sheet", LIT, lambda: furnace(change=light.with_sheet, eyes=(EYE, OVER_THE_SHEET)), 2),
    known("a bake of a metal floor", LIT, lambda: furnace(change=metal_floor), 2),
    known("a bake of a room of B = 0.2, behind 0.3 m of wall from one of 50", "B is 0.2", dim_beside_bright, 0.2),
    known("a frame from within a block", LIT, from_within, 2, slow=False),
    known("a frame of a floor that is edge-on", LIT, edge_on, 2),
    known("a bake of a house on 200 m of ground", LIT, lambda: furnace(change=house_on_ground(100)), 2, BOTH),
    known("a bake of a house on 100 km of ground", LIT, lambda: furnace(change=house_on_ground(5e4)), 2, BOTH,
          slow=False),
    Case("Light", "a bake of a room 1,000 km from the origin", "refused: float32 has positions every 6 cm there",
         lambda: KnownLight(lambda: furnace(place=Place(np.eye(3), 1e6 * AWAY)), 2), {"bake": GAUSSIAN},
         (SceneError, "move it to the origin")),
]  # fmt: skip

PLACES = [
    ("10 km from the origin", Place(np.eye(3), 1e4 * AWAY)),
    ("scaled by 1e-3", scaled(1e-3)),
    ("scaled by 1e3", scaled(1e3)),
    ("mirrored", Place(light.MIRROR, np.zeros(3))),
    ("axes permuted", Place(light.AXES, np.zeros(3))),
    ("along no axis", Place(light.turned(), np.zeros(3))),
]

QUICK = "10 km from the origin", "mirrored"

INVARIANCE = [
    *[
        Case("Invariance", f"a furnace, {name}", EVERYWHERE, lambda place=place: KnownLight(
            lambda: furnace(place=place), 2), BOTH, slow=True)
        for name, place in PLACES
    ],
    *[unchanged(name, place, slow=name not in QUICK) for name, place in PLACES],
    unchanged("triangles shuffled, each a mesh", change=light.split),
    unchanged("meshes merged", change=merged),
    unchanged("a far-away object added", change=with_meshes(
        *[moved(mesh, (5e4, 0, 0)) for mesh in scenes.box(inward=False)])),
]  # fmt: skip
