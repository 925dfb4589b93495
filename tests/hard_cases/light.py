"""Path-traced light with known answers: furnaces, darkness, tiny lamps, thin walls, scenes of every size and place."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scenes

from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Light, Material, Mesh, Scene

from .case import Case, Measured, Tolerance
from .small_bakes import around

UP = np.array([[0, 1, 0]], np.float32)
EXACT = Tolerance(0, "no light is no light")
NONE = np.zeros(3)


def even_points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Position and normal (count, 3) of points spread over the inner walls of `scenes.box()`."""
    rng = np.random.default_rng(0)
    normal = np.concatenate([np.repeat(mesh.normal[:1], count // 6, axis=0) for mesh in scenes.box()])
    spread = rng.uniform(-1, 1, normal.shape).astype(np.float32)
    return np.where(normal != 0, -normal, spread).astype(np.float32), normal


def mean_light(scene: Scene, position: np.ndarray, normal: np.ndarray, paths: int) -> float:
    light = Tracer(scene).indirect(position, normal, normal, Sampling(paths), seed=1).mean
    assert np.isfinite(light).all()
    return float(light.mean())


def furnace_error(
    albedo: float, emission: float = 1.0, paths: int = 64, change: Callable[[Scene], Scene] | None = None,
    move: Callable[[np.ndarray], np.ndarray] = lambda p: p, turn: np.ndarray | None = None,
) -> float:  # fmt: skip
    """Relative error of the mean B of a closed emitting cube, which is L / (1 - r); of `change` of it, moved."""
    scene = scenes.furnace(albedo, emission)
    turn = np.eye(3) if turn is None else turn
    meshes = [replace(m, position=move(m.position.astype(float) @ turn.T).astype(np.float32),
                      normal=(m.normal @ turn.T).astype(np.float32),
                      triangle=m.triangle if np.linalg.det(turn) > 0 else m.triangle[:, ::-1].copy())
              for m in scene.meshes]  # fmt: skip
    scene = replace(scene, meshes=tuple(meshes))
    if change is not None:
        scene = change(scene)
    position, normal = even_points(384)
    points = move(position.astype(float) @ turn.T).astype(np.float32), (normal @ turn.T).astype(np.float32)
    return abs(mean_light(scene, *points, paths) / (emission / (1 - albedo)) - 1)


def dark(scene: Scene) -> float:
    """The mean B on the inner walls, which get no light."""
    position, normal = even_points(96)
    return mean_light(scene, position * np.abs(scene.meshes[0].position).max(), normal, 64)


def at_edges() -> float:
    """The mean B of pixels of a dark room behind whose walls there is light. Some meet the edges between two walls."""
    scene = shell(1.001)
    tracer = Tracer(scene)
    seen = [tracer.surface(camera, 64, 64).points() for camera in around((0.0, 0.0, 0.0))]
    position, normal, _ = (np.concatenate(part) for part in zip(*seen, strict=True))
    return mean_light(scene, position, normal, 32)


def doubled_walls() -> float:
    """Relative change of the mean B of a grey room under a lamp in its middle, when each wall is there twice."""
    lamp = Light("point", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    once = Scene(tuple(scenes.box()), (scenes.WHITE,), lights=(lamp,))
    twice = replace(once, meshes=once.meshes * 2)
    single, double = (mean_light(scene, *even_points(384), 64) for scene in (once, twice))
    assert single > 0.1
    return abs(double / single - 1)


def tiny_lamp(edge: float, radiance: float) -> float:
    """Relative error of B one metre below a square lamp in an else black scene: L A / pi, as long as it is small."""
    black = Material("black", (0.0, 0.0, 0.0, 1.0))
    lamp = Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(radiance,) * 3)
    lid = scenes.floor(half=edge / 2, height=1.0, material=1)
    lid = replace(lid, triangle=lid.triangle[:, ::-1].copy(), normal=-lid.normal)
    light = mean_light(
        Scene((scenes.floor(5.0), lid), (black, lamp)), np.zeros((16, 3), np.float32), UP.repeat(16, 0), 64
    )
    return abs(light / (radiance * edge**2 / np.pi) - 1)


def shell(beyond: float, half: float = 1.0) -> Scene:
    """A dark closed room of `half` edge, m, and walls `beyond` times as far out that shine on both sides."""
    grey = Material("grey", (0.5, 0.5, 0.5, 1.0))
    sun = Material("sun", (0.0, 0.0, 0.0, 1.0), emission=(1e4,) * 3, double_sided=True)
    return Scene((*scenes.box(half), *scenes.box(half * beyond, 1)), (grey, sun))


def with_meshes(*more: Mesh) -> Callable[[Scene], Scene]:
    return lambda scene: replace(scene, meshes=(*scene.meshes, *more))


def split(scene: Scene) -> Scene:
    """Every triangle a mesh of its own, in another order."""
    parts = [replace(m, triangle=triangle[None]) for m in scene.meshes for triangle in m.triangle]
    return replace(scene, meshes=tuple(parts[k] for k in np.random.default_rng(5).permutation(len(parts))))


def merged(scene: Scene) -> Scene:
    """All in one mesh."""
    offsets = np.cumsum([0, *(len(m.position) for m in scene.meshes[:-1])]).astype(np.uint32)
    triangle = np.concatenate([m.triangle + at for m, at in zip(scene.meshes, offsets, strict=True)])
    arrays = {name: np.concatenate([getattr(m, name) for m in scene.meshes]) for name in ("position", "normal", "uv")}
    return replace(scene, meshes=(replace(scene.meshes[0], triangle=triangle, **arrays),))


def slivers() -> Mesh:
    """Triangles without area and of aspect 1e6, on the floor of the room."""
    position = np.float32([[0, -1, 0], [0, -1, 0], [1, -1, 0], [-1, -1, 0.3], [1, -1, 0.3], [1, -1, 0.300001]])
    triangle = np.uint32([[0, 1, 2], [3, 4, 5]])
    normal = np.tile(np.float32([0, 1, 0]), (6, 1))
    return Mesh(position, normal, np.zeros((6, 1, 2), np.float32), triangle, 0)


def lying_on_it(back_to_back: bool, other_triangles: bool, material: int) -> Callable[[Scene], Scene]:
    """A second face on each wall: one-sided, of material 0 or of an unlit one, cut along the other diagonal or not."""

    def change(scene: Scene) -> Scene:
        unlit = Material("unlit", scene.materials[0].base_color)
        more = []
        for mesh in scene.meshes:
            triangle = np.uint32([[0, 1, 3], [1, 2, 3]]) if other_triangles else mesh.triangle
            side = -1 if back_to_back else 1
            more.append(replace(mesh, triangle=triangle[:, ::side].copy(), normal=side * mesh.normal,
                                material=material))  # fmt: skip
        # Half of the walls come before those that lie on them, half after.
        meshes = *scene.meshes[:3], *more, *scene.meshes[3:]
        return replace(scene, meshes=meshes, materials=(*scene.materials, unlit))

    return change


def flush_lamp(turn: np.ndarray) -> float:
    """Relative change of the mean B on floor and walls when a lamp 1 mm below the ceiling rises into its plane."""
    lamp = Material("lamp", (0.5, 0.5, 0.5, 1.0), emission=(1.0, 1.0, 1.0))
    position, normal = (array[np.repeat(np.arange(6) != 3, 64)] for array in even_points(384))
    light = []
    for below in (1e-3, 0.0):
        panel = scenes.floor(0.5, 1.0 - below, 1)
        panel = replace(panel, triangle=panel.triangle[:, ::-1].copy(), normal=-panel.normal)
        meshes = [replace(m, position=(m.position.astype(float) @ turn.T).astype(np.float32),
                          normal=(m.normal @ turn.T).astype(np.float32)) for m in (*scenes.box(), panel)]  # fmt: skip
        scene = Scene(tuple(meshes), (scenes.WHITE, lamp))
        light.append(mean_light(scene, *((a @ turn.T).astype(np.float32) for a in (position, normal)), 512))
    return abs(light[1] / light[0] - 1)


def inside_out(scene: Scene) -> Scene:
    return replace(scene, meshes=tuple(replace(mesh, normal=-mesh.normal) for mesh in scene.meshes))


def with_sheet(scene: Scene) -> Scene:
    """A two-sided sheet of the walls' material across the middle."""
    sheet = replace(scenes.floor(0.6, 0.1), material=len(scene.materials))
    return replace(scene, meshes=(*scene.meshes, sheet),
                   materials=(*scene.materials, replace(scene.materials[0], double_sided=True)))  # fmt: skip


def next_room(dark_side: bool) -> float:
    """Two rooms on one floor and under one ceiling, 1 mm apart, of albedo 0.5.

    In one the walls shine. The other is dark, and its largest B is returned; or its walls shine 250 times less, and
    the larger relative error of a room's mean B is returned.
    """
    albedo = (0.5, 0.5, 0.5, 1.0)
    bright, other = 25.0, 0.0 if dark_side else 0.1
    materials = [Material("wall", albedo, emission=(radiance,) * 3) for radiance in (bright, other)]
    gap = np.float32([2.001, 0, 0])
    rooms = [[replace(m, position=m.position + k * gap, material=k) for m in scenes.box()] for k in (0, 1)]
    if dark_side:  # floor and ceiling run on, dark, and only the other walls of the bright room shine
        across = [m for m in scenes.box() if m.normal[0, 1]]
        wide = [replace(m, position=m.position * np.float32([2.0005, 1, 1]) + gap / 2, material=1) for m in across]
        rooms = [[m for m in room if not m.normal[0, 1]] for room in rooms] + [wide]
    scene = Scene(tuple(mesh for room in rooms for mesh in room), tuple(materials))
    position, normal = even_points(192)
    light = [mean_light(scene, position + k * gap, normal, 128) for k in (0, 1)]
    if dark_side:
        assert light[0] > 1
        return light[1]
    return max(abs(found / (2 * radiance) - 1) for found, radiance in zip(light, (bright, other), strict=True))


def turned() -> np.ndarray:
    """A rotation (3, 3) that leaves nothing along an axis."""
    rotation, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return rotation * np.linalg.det(rotation)


def case(group: str, name: str, holds: str, measure, tolerance: Tolerance) -> Case:
    return Case(group, name, holds, lambda: Measured({"tracer": lambda _: measure()}), {"tracer": tolerance})


def furnace(name: str, noise: float, *arguments, group: str = "Light", **how) -> Case:
    tolerance = Tolerance(noise, "three standard errors of 384 points, and no bounce lost")
    return case(group, name, "B = L / (1 - r) everywhere", lambda: furnace_error(*arguments, **how), tolerance)


def unchanged(name: str, **how) -> Case:
    return furnace(name, 0.015, 0.8, 1.0, 128, group="Invariance", **how)


NO_LIGHT = Scene(tuple(scenes.box()), (Material("white", (1.0, 1.0, 1.0, 1.0)),))
AWAY = np.array([1.0, -0.7, 0.4])
MIRROR, AXES = np.diag([-1.0, 1, 1]), np.eye(3)[[1, 2, 0]]

CASES = [
    furnace("furnace of albedo 0", 0.005, 0.0),
    furnace("furnace of albedo 0.5", 0.01, 0.5),
    furnace("furnace of albedo 0.9", 0.02, 0.9, 1.0, 128),
    furnace("furnace of albedo 0.99", 0.03, 0.99),
    furnace("furnace of radiance 1e-6", 0.01, 0.5, 1e-6),
    furnace("furnace of radiance 1e6", 0.01, 0.5, 1e6),
    case("Light", "a closed room of albedo 1 without light", "it is black", lambda: dark(NO_LIGHT), EXACT),
    case("Light", "light behind a 1 mm wall", "none comes through", lambda: dark(shell(1.001)), EXACT),
    case("Light", "light behind a 1 mm wall, at pixels on the edges of the room", "none comes through", at_edges,
         Tolerance(0.01, "1e-6 of the light: a path in 1e6 meets an edge to its rounding, and goes on behind it")),
    case("Light", "light behind a wall of 0.01 mm", "none comes through", lambda: dark(shell(1.00001)), EXACT),
    *[
        case("Light", f"a lamp of {edge} m and radiance {radiance:g}", "B = L A / pi, without fireflies",
             lambda edge=edge, radiance=radiance: tiny_lamp(edge, radiance),
             Tolerance(0.01, "the lamp's size: (edge / distance)^2, and rounding"))
        for edge, radiance in ((0.01, 1e4), (1e-3, 1e6), (1e-4, 1e8))
    ],
    furnace("slivers and triangles without area on the floor", 0.015, 0.8, 1.0, 128, change=with_meshes(slivers())),
    case("Light", "coplanar faces, all walls doubled", "B is that of single walls", doubled_walls,
         Tolerance(0.01, "which of two equal walls a ray meets changes nothing but rounding")),
    case("Light", "light behind a 1 mm wall of a hall of 200 m", "none comes through",
         lambda: dark(shell(1.00001, 100)), EXACT),
    *[
        furnace(f"a lit wall {what}", 0.015, 0.8, 1.0, 128, change=lying_on_it(*on_it), turn=turn)
        for what, turn, on_it in (
            ("and an unlit one at the same place", None, (False, False, 1)),
            ("at the same place, lit as well", None, (False, False, 0)),
            ("back to back with an unlit one", None, (True, False, 1)),
            ("in the plane of another one, of other triangles", None, (False, True, 0)),
            ("along no axis, in the plane of another one, of other triangles", turned(), (False, True, 0)),
            ("in the plane of an unlit one of other triangles", None, (False, True, 1)),
            ("along no axis, in the plane of an unlit one of other triangles", turned(), (False, True, 1)),
            ("back to back with an unlit one of other triangles", None, (True, True, 1)),
            ("along no axis, back to back with an unlit one of other triangles", turned(), (True, True, 1)))
    ],
    *[
        case("Light", f"a lamp in the plane of a ceiling{where}", "B is that of a lamp 1 mm below it",
             lambda turn=turn: flush_lamp(turn),
             Tolerance(0.01, "a millimetre, and three standard errors of 320 points"))
        for where, turn in (("", np.eye(3)), (" that lies along no axis", turned()))
    ],
    furnace("normals of vertices that face away from their triangles", 0.015, 0.8, 1.0, 128, change=inside_out),
    furnace("a two-sided sheet in the middle, lit as the walls", 0.015, 0.8, 1.0, 128, change=with_sheet),
    case("Light", "light in the next room, behind a 1 mm wall on the same floor", "none comes through",
         lambda: next_room(dark_side=True), EXACT),
    case("Light", "a room of B = 0.2 beside one of 50", "each has its own",
         lambda: next_room(dark_side=False), Tolerance(0.01, "three standard errors of 192 points")),
]  # fmt: skip

INVARIANCE = [
    unchanged("turned to lie along no axis", turn=turned()),
    unchanged("1 km from the origin", move=lambda p: p + 1e3 * AWAY),
    unchanged("10 km from the origin, turned", move=lambda p: p + 1e4 * AWAY, turn=turned()),
    unchanged("scaled by 1e-3", move=lambda p: p * 1e-3),
    unchanged("scaled by 1e3", move=lambda p: p * 1e3),
    unchanged("scaled by 1e5", move=lambda p: p * 1e5),
    unchanged("mirrored", turn=MIRROR),
    unchanged("axes permuted", turn=AXES),
    unchanged("triangles shuffled, each a mesh", change=split),
    unchanged("one mesh", change=merged),
    unchanged("a far-away object added", change=with_meshes(*(replace(m, position=m.position + np.float32(5e4))
                                                              for m in scenes.box()))),
    unchanged("on 200 m of ground", change=with_meshes(scenes.floor(100.0, -1.5))),
    unchanged("on 100 km of ground", change=with_meshes(scenes.floor(5e4, -1.5))),
    unchanged("beside a triangle of 1e15 m", change=with_meshes(scenes.floor(1e15, -1.5))),
]  # fmt: skip
