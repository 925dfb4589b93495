"""Write the sample scenes to samples/scenes/. Every run writes the same bytes, and a test compares them.

python samples/make_scenes.py
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from glb_writer import Glb, face_normal, unit

FOLDER = Path(__file__).parent / "scenes"

# The Cornell box, https://www.graphics.cornell.edu/online/box/data.html, in mm. y is up. The camera at
# (278, 273, -800) looks along +z, so x points to its left.
CORNELL_WALLS = {
    "floor": ("white", [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]),
    "ceiling": ("white", [(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)]),
    "back wall": ("white", [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)]),
    "right wall": ("green", [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)]),
    "left wall": ("red", [(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)]),
}
CORNELL_BLOCKS = {  # corners of the base, height
    "short block": ([(130, 65), (82, 225), (240, 272), (290, 114)], 165),
    "tall block": ([(423, 247), (265, 296), (314, 456), (472, 406)], 330),
}
CORNELL_LIGHT = [(343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227)]
CORNELL_YFOV = 2 * np.arctan(0.0125 / 0.035)  # film 25 mm, focal length 35 mm
REFLECTANCE = {"white": (0.73, 0.73, 0.73), "red": (0.65, 0.05, 0.05), "green": (0.12, 0.45, 0.15)}


def facing(quad: np.ndarray, point: np.ndarray, away: bool = False) -> np.ndarray:
    """The rectangle, turned so that its front faces a point, or away from it."""
    quad = np.asarray(quad, float)
    front = ((np.asarray(point) - quad.mean(axis=0)) * face_normal(quad)).sum() > 0
    return quad if front != away else quad[::-1]


def box(low, high, inward: bool = False) -> list[np.ndarray]:
    """The six sides of an axis-aligned box, facing out or in."""
    x, y, z = np.transpose([low, high])
    sides = [[(a, y[0], z[0]), (a, y[1], z[0]), (a, y[1], z[1]), (a, y[0], z[1])] for a in x]
    sides += [[(x[0], a, z[0]), (x[1], a, z[0]), (x[1], a, z[1]), (x[0], a, z[1])] for a in y]
    sides += [[(x[0], y[0], a), (x[1], y[0], a), (x[1], y[1], a), (x[0], y[1], a)] for a in z]
    middle = np.add(low, high) / 2
    return [facing(side, middle, away=not inward) for side in sides]


def wall(at: float, span, height: float, towards: float, openings=(), axis: str = "x") -> list[np.ndarray]:
    """One side of a wall from the floor to `height`, in the plane x (or z) = `at`, facing x (or z) = `towards`.

    It reaches along `span`. In order along it lie `openings` (start, end, bottom, top), which it leaves free.
    """
    edges = [span[0], *(edge for opening in openings for edge in opening[:2]), span[1]]
    parts = [(a, b, 0, height) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    parts += [part for a, b, low, high in openings for part in ((a, b, 0, low), (a, b, high, height))]
    outlines = [[(a, low), (b, low), (b, high), (a, high)] for a, b, low, high in parts if a < b and low < high]
    return [
        facing([upright(at, *p, axis) for p in outline], upright(towards, *outline[0], axis)) for outline in outlines
    ]


def reveal(sides, opening, axis: str = "x") -> list[np.ndarray]:
    """The faces within an opening (start, end, bottom, top) of a wall between its two `sides`, facing in; no sill."""
    start, end, low, high = opening
    lines = [(start, low), (start, high)], [(end, low), (end, high)], [(start, high), (end, high)]
    middle = upright(sum(sides) / 2, (start + end) / 2, (low + high) / 2, axis)
    quads = (
        [upright(at, *p, axis) for at, p in zip((*sides, *sides[::-1]), (a, a, b, b), strict=True)] for a, b in lines
    )
    return [facing(quad, middle) for quad in quads]


def upright(at: float, along: float, y: float, axis: str = "x") -> tuple[float, float, float]:
    """A point of the plane x (or z) = `at`."""
    return (at, y, along) if axis == "x" else (along, y, at)


def level(x, z, y: float, down: bool = False) -> np.ndarray:
    """The rectangle of a floor, or of a ceiling, which faces down."""
    quad = [(x[0], y, z[0]), (x[1], y, z[0]), (x[1], y, z[1]), (x[0], y, z[1])]
    return facing(quad, (quad[0][0], y + (-1 if down else 1), quad[0][2]))


def table(x: float, z: float) -> list[np.ndarray]:
    """A table of 1.2 m by 0.7 m in the middle of which is (x, z)."""
    boxes = [box((x - 0.6, 0.7, z - 0.35), (x + 0.6, 0.74, z + 0.35))]
    boxes += [
        box((x + a - 0.03, 0, z + b - 0.03), (x + a + 0.03, 0.7, z + b + 0.03))
        for a in (-0.5, 0.5)
        for b in (-0.28, 0.28)
    ]
    return [side for sides in boxes for side in sides]


def from_cornell(points) -> np.ndarray:
    """Convert Cornell's mm to metres and turn by 180 degrees about y: x points right, the room opens at z = 0."""
    return (np.asarray(points, float) * (-1, 1, -1) + (278, 0, 0)) / 1000


def cornell_room(glb: Glb):
    """Add walls that face in, blocks that face out, and two cameras."""
    materials = {name: glb.material(name, color) for name, color in REFLECTANCE.items()}
    centre = from_cornell((278, 274, 280))
    for name, (color, corners) in CORNELL_WALLS.items():
        glb.solid(name, [facing(from_cornell(corners), centre)], materials[color])
    for name, (base, height) in CORNELL_BLOCKS.items():
        low = from_cornell([(x, 0, z) for x, z in base])
        high = from_cornell([(x, height, z) for x, z in base])
        sides = [(low[i - 1], low[i], high[i], high[i - 1]) for i in range(4)]
        middle = (low + high).mean(axis=0) / 2
        quads = [facing(quad, middle, away=True) for quad in [high, *sides]]  # no bottom: it lies on the floor
        glb.solid(name, quads, materials["white"])
    glb.camera("front", from_cornell((278, 273, -800)), from_cornell((278, 273, 0)), CORNELL_YFOV)
    glb.camera("corner", (-0.2, 0.46, -0.01), (0.03, 0.13, -0.38), 1.35)


def cornell() -> Glb:
    """The box, lit by one spot light below the middle of the ceiling; the ceiling itself gets no direct light."""
    glb = Glb()
    cornell_room(glb)
    place = from_cornell(CORNELL_LIGHT).mean(axis=0) - (0, 0.005, 0)
    down = (-0.7071068, 0, 0, 0.7071068)  # a quarter turn about x: -Z to -Y
    cone = {"innerConeAngle": round(np.radians(55), 7), "outerConeAngle": round(np.radians(75), 7)}
    color = [1, 0.9, 0.75]
    glb.light("ceiling spot", place.round(7).tolist(), down, type="spot", color=color, intensity=1.2, spot=cone)
    return glb


def cornell_emissive() -> Glb:
    """The box, lit by the emissive quad of the ceiling, without punctual lights."""
    glb = Glb()
    cornell_room(glb)
    lamp = glb.material("lamp", (0.78, 0.78, 0.78), **glb.emission(15))
    quad = from_cornell(CORNELL_LIGHT) - (0, 0.001, 0)  # 1 mm below the ceiling, so that the two are not coplanar
    glb.solid("lamp", [facing(quad, from_cornell((278, 0, 280)))], lamp)
    return glb


def two_rooms() -> Glb:
    """A bright and a dark room, both closed, 2 cm apart: any light in the dark one has leaked."""
    glb = Glb()
    plaster, wood = glb.material("plaster", (0.75, 0.72, 0.68)), glb.material("wood", (0.5, 0.3, 0.15))
    bright = glb.solid("bright room", box((-4, 0, -3), (-0.01, 2.5, 0), inward=True), plaster)
    dark = glb.solid("dark room", box((0.01, 0, -3), (4, 2.5, 0), inward=True), plaster)
    glb.light("bulb", [-2.2, 2.0, -1.4], type="point", color=[1, 0.85, 0.65], intensity=6, range=8)

    squares = np.indices((8, 8)).sum(axis=0)[..., None] % 2
    checker = np.where(squares, [230, 220, 200], [150, 40, 30]).astype(np.uint8)
    rug = glb.material("rug", (1, 1, 1), texture=glb.texture(checker))
    sheet = np.array([(-0.8, 0, 0.6), (0.8, 0, 0.6), (0.8, 0, -0.6), (-0.8, 0, -0.6)])
    on_floor = glb.node("rug", root=False, mesh=glb.mesh("rug", [sheet], rug, 2), translation=[-2.4, 0.005, -1.2])

    holes = np.full((8, 8, 4), (90, 120, 160, 255), np.uint8)
    holes[2:6, 2:6, 3] = 0
    masked = {"alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": True}
    lattice = glb.material("lattice", (1, 1, 1), texture=glb.texture(holes), **masked)
    upright = np.array([(-0.5, 0, 0), (0.5, 0, 0), (0.5, 1.6, 0), (-0.5, 1.6, 0)])
    screen = glb.node("screen", root=False, mesh=glb.mesh("screen", [upright], lattice, 4))
    turned = glb.node("screen place", root=False, translation=[-1.0, 0, -1.6], rotation=[0, 0.6, 0, 0.8])
    glb.json["nodes"][turned]["children"] = [screen]

    # A mirror-symmetric table: two legs and half of the top are used twice, the second time with x negated.
    half = box((0, 0.68, -0.3), (0.5, 0.72, 0.3)) + [
        side for z in (-0.26, 0.2) for side in box((0.4, 0, z), (0.46, 0.68, z + 0.06))
    ]
    table_half = glb.mesh("table half", half, wood)
    for room, place in ((bright, [-3.2, 0, -2.2]), (dark, [1.6, 0, -1.6])):
        right = glb.node("table right half", root=False, mesh=table_half)
        left = glb.node("table left half", root=False, mesh=table_half, scale=[-1, 1, 1])
        table = glb.node("table", root=False, children=[right, left], translation=place)
        glb.json["nodes"][room]["children"] = [table]
    glb.json["nodes"][bright]["children"] += [on_floor, turned]

    glb.camera("bright", (-0.4, 1.7, -0.3), (-3.0, 0.6, -2.0), 1.1)
    glb.camera("dark", (3.6, 1.7, -0.3), (0.8, 0.7, -2.0), 1.1)
    return glb


def house(ground: float = 200) -> Glb:
    """Two closed rooms of 4 x 3 x 4 m, of which one has a lamp, in the middle of a dark ground of this edge, m."""
    glb = Glb()
    plaster, brick = glb.material("plaster", (0.78, 0.76, 0.72)), glb.material("brick", (0.45, 0.2, 0.15))
    wood, grass = glb.material("wood", (0.5, 0.32, 0.18)), glb.material("grass", (0.2, 0.35, 0.1))
    lamp = glb.material("lamp", (0.5, 0.5, 0.5), **glb.emission(12))
    height, door = 3, (-2.4, -1.5, 0, 2.1)
    for name, x, inner, outer in (("living room", (-4.1, -0.1), -0.1, -4.1), ("bedroom", (0.1, 4.1), 0.1, 4.1)):
        ends = wall(inner, (-4, 0), height, outer, [door]) + wall(outer, (-4, 0), height, inner)
        sides = wall(-4, x, height, 0, axis="z") + wall(0, x, height, -4, axis="z")
        glb.solid(name, [*ends, *sides, level(x, (-4, 0), height, down=True)], plaster)
        glb.solid(f"floor of the {name}", [level(x, (-4, 0), 0)], wood)
    glb.solid("doorway", [*reveal((-0.1, 0.1), door), level((-0.1, 0.1), door[:2], 0)], plaster)
    glb.solid(
        "furniture",
        table(-2.6, -2.6) + box((2.2, 0, -3.9), (4, 0.5, -2.3)) + box((-4.0, 0, -1.2), (-3.5, 1.9, -0.2)),
        wood,
    )
    glb.solid("lamp", [level((-2.4, -1.8), (-2.3, -1.7), 2.95, down=True)], lamp)
    low, high = (-4.3, -0.1, -4.2), (4.3, 3.2, 0.2)
    glb.solid("outer walls", [side for side in box(low, high) if side[:, 1].max() > 0], brick)
    glb.solid("ground", [level((-ground / 2, ground / 2), (-ground / 2, ground / 2), -0.1)], grass)
    glb.camera("living room", (-0.5, 1.6, -0.4), (-3.2, 0.9, -3.0), 1.1)
    glb.camera("bedroom", (3.7, 1.6, -0.4), (0.8, 0.9, -2.6), 1.1)
    return glb


def gaps() -> Glb:
    """A bright room between a sealed one, behind a wall of 1 mm, and one behind a wall of 10 cm with a door.

    Under the door is a gap of 1 cm. The floor, the ceiling and the long walls run on under and behind both walls.
    """
    glb = Glb()
    plaster, wood = glb.material("plaster", (0.75, 0.72, 0.68)), glb.material("wood", (0.5, 0.32, 0.18))
    canvas, lamp = glb.material("canvas", (0.2, 0.3, 0.5)), glb.material("lamp", (0.5, 0.5, 0.5), **glb.emission(10))
    x, z, height, door = (-4, 8), (-3, 0), 2.6, (-2.0, -1.1, 0, 2.1)
    sides = wall(-3, x, height, 0, axis="z") + wall(0, x, height, -3, axis="z")
    glb.solid(
        "shell", [*sides, *wall(-4, z, height, 8), *wall(8, z, height, -4), level(x, z, height, down=True)], plaster
    )
    glb.solid("floor", [level(x, z, 0)], wood)
    glb.solid("thin wall", wall(-0.0005, z, height, -4) + wall(0.0005, z, height, 8), plaster)
    glb.solid(
        "wall", wall(4, z, height, -4, [door]) + wall(4.1, z, height, 8, [door]) + reveal((4, 4.1), door), plaster
    )
    glb.solid("door", box((4.03, 0.01, door[0]), (4.07, door[3], door[1])), wood)
    glb.solid("picture", box((3.96, 1.1, -0.9), (3.985, 1.8, -0.2)), canvas)  # it hangs 1.5 cm off the wall
    for number, place in enumerate((-2, 2, 6)):
        glb.solid(f"table {number}", table(place, -2), wood)
    glb.solid("lamp", [level((1.6, 2.4), (-1.9, -1.1), 2.55, down=True)], lamp)
    glb.camera("bright", (0.4, 1.6, -0.3), (3.6, 1.0, -1.9), 1.1)
    glb.camera("sealed", (-3.6, 1.6, -0.3), (-0.4, 0.7, -2.0), 1.1)
    glb.camera("behind the door", (7.6, 1.6, -0.3), (4.4, 0.7, -1.7), 1.1)
    return glb


def cells() -> Glb:
    """Five cells that see a corridor through hatches: three under lamps of 1,000, 30 and 1, and two without."""
    glb = Glb()
    paint, stone = glb.material("paint", (0.55, 0.6, 0.5)), glb.material("stone", (0.3, 0.28, 0.26))
    bed, wide, height, half = glb.material("bed", (0.4, 0.3, 0.2)), 2.4, 2.7, 0.05
    x, z = (0, 5 * wide), (-3.2, 2.3)
    hatches = [(start + 1.0, start + 1.4, 1.3, 1.55) for start in np.arange(5) * wide]
    shell = wall(z[0], x, height, 1, axis="z") + wall(z[1], x, height, -1, axis="z")
    shell += wall(x[0], z, height, 1) + wall(x[1], z, height, -1) + [level(x, z, height, down=True)]
    shell += wall(-half, x, height, z[0], hatches, "z") + wall(half, x, height, z[1], hatches, "z")
    for hatch in hatches:
        shell += [*reveal((-half, half), hatch, "z"), level(hatch[:2], (-half, half), hatch[2])]
    for at in np.arange(1, 5) * wide:
        shell += wall(at - half, (z[0], -half), height, 0) + wall(at + half, (z[0], -half), height, x[1])
    glb.solid("walls", shell, paint)
    glb.solid("floor", [level(x, z, 0)], stone)
    for number, (power, name) in enumerate([(0, "dark"), (1000, "bright"), (0, "darker"), (1, "dim"), (30, "lit")]):
        start = number * wide
        glb.solid(f"bed {number}", box((start + 0.15, 0, -3.15), (start + 0.95, 0.5, -1.25)), bed)
        if power:
            lamp = glb.material(f"lamp {number}", (0.5, 0.5, 0.5), **glb.emission(power))
            glb.solid(
                f"lamp {number}", box((start + 1.4, height - 0.1, -1.7), (start + 1.6, height - 0.05, -1.5)), lamp
            )
        glb.camera(name, (start + 2.1, 1.6, -0.3), (start + 0.6, 0.7, -2.6), 1.1)
    glb.camera("corridor", (0.4, 1.6, 1.2), (x[1], 1.1, 1.0), 1.1)
    return glb


def corridor() -> Glb:
    """A corridor of 20 m with one bright window at its end and niches that the window hardly reaches."""
    glb = Glb()
    plaster, wood = glb.material("plaster", (0.7, 0.68, 0.62)), glb.material("wood", (0.45, 0.3, 0.18))
    sky = glb.material("sky", (0, 0, 0), **glb.emission(40))
    x, z, height, deep = (-1, 1), (-20, 0), 2.6, 0.7
    niches = {1: [(-18, -17, 0, 2.1), (-10, -9, 0, 2.1)], -1: [(-14, -13, 0, 2.1), (-5, -4, 0, 2.1)]}
    window = (-0.6, 0.6, 0.9, 2.2)
    shell = wall(-20, x, height, 0, axis="z") + wall(0, x, height, -20, [window], axis="z")
    shell += [*reveal((0, 0.2), window, axis="z"), level(window[:2], (0, 0.2), window[2])]
    shell.append(level(x, z, height, down=True))
    floor = [level(x, z, 0)]
    for side, openings in niches.items():
        shell += wall(side, z, height, 0, openings)
        for opening in openings:
            back = (side, side * (1 + deep))
            shell += wall(back[1], opening[:2], opening[3], 0) + reveal(back, opening)
            floor.append(level(sorted(back), opening[:2], 0))
    glb.solid("corridor", shell, plaster)
    glb.solid("floor", floor, wood)
    glb.solid("chest", box((1.15, 0, -17.9), (1.65, 0.8, -17.1)) + box((-1.6, 0, -4.8), (-1.2, 1.2, -4.3)), wood)
    glb.solid("sky", wall(0.2, window[:2], window[3], -20, [(window[0], window[1], 0, window[2])], axis="z"), sky)
    glb.camera("at the window", (0.5, 1.6, -0.6), (-0.6, 1.0, -6), 1.1)
    glb.camera("in the middle", (-0.6, 1.6, -8.0), (0.5, 1.0, -13), 1.1)
    glb.camera("at the end", (-0.6, 1.6, -19.6), (0.7, 0.9, -16), 1.1)
    glb.camera("in a niche", (1.5, 1.5, -9.2), (-1, 1.0, -11), 1.1)
    return glb


def ball(centre, radius: float, steps: int = 6) -> list[np.ndarray]:
    """A faceted ball: the sides of a cube, each of `steps` x `steps` rectangles, drawn onto the sphere."""
    places = np.linspace(-1, 1, steps + 1)
    quads = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for a, c in pairwise(places):
                for b, d in pairwise(places):
                    corners = np.array([(a, b, side), (c, b, side), (c, d, side), (a, d, side)])
                    on_sphere = np.roll([unit(corner) for corner in corners], axis, axis=1)
                    quads.append(facing(centre + radius * on_sphere, centre, away=True))
    return quads


def metals() -> Glb:
    """A closed room with a steel floor, a gold ball and a wall that is copper in every other tile.

    A spot shines at one wall of plaster, so that light reaches the metals by bounces alone.
    """
    glb = Glb()
    plaster = glb.material("plaster", (0.75, 0.72, 0.68))
    steel = glb.material("steel", (0.56, 0.57, 0.58), metallic=1)
    gold = glb.material("gold", (1.0, 0.77, 0.34), metallic=1)
    tiles = np.zeros((2, 2, 3), np.uint8)
    tiles[[0, 1], [0, 1], 2] = 255
    copper = glb.material("copper tiles", (0.95, 0.64, 0.54), metallic=1, metal_texture=glb.texture(tiles))
    left, right, floor, ceiling, back, front = box((-1.5, 0, -1.5), (1.5, 2.4, 1.5), inward=True)
    glb.solid("walls", [left, right, ceiling, front], plaster)
    glb.solid("floor", [floor], steel)
    glb.node("tiled wall", mesh=glb.mesh("tiled wall", [back], copper, 4))
    glb.solid("ball", ball(np.array([0.5, 0.45, -0.5]), 0.45), gold)
    cone = {"innerConeAngle": 0.3, "outerConeAngle": 0.55}
    to_the_left = [0, 0.7071068, 0, 0.7071068]  # a quarter turn about y: -Z to -X
    glb.light("spot", [0.2, 1.5, 0.2], to_the_left, type="spot", color=[1, 0.95, 0.9], intensity=12, spot=cone)
    glb.camera("inside", (1.2, 1.5, 1.35), (-0.2, 0.5, -0.9), 1.1)
    return glb


def chapel() -> Glb:
    """A closed room of 4 x 3.5 x 6 m in the sun, with two windows of stained glass and one behind a sheer curtain."""
    glb = Glb()
    plaster, stone = glb.material("plaster", (0.75, 0.72, 0.68)), glb.material("stone", (0.6, 0.58, 0.54))
    oak = glb.material("oak", (0.45, 0.28, 0.15))
    height, windows = 3.5, [(-5.2, -4.2, 1.0, 2.8), (-3.5, -2.5, 1.0, 2.8), (-1.8, -0.8, 1.0, 2.8)]
    walls = wall(-2, (-6, 0), height, 0, windows) + wall(2, (-6, 0), height, 0)
    walls += wall(-6, (-2, 2), height, 0, axis="z") + wall(0, (-2, 2), height, -6, axis="z")
    glb.solid("walls", [*walls, level((-2, 2), (-6, 0), height, down=True)], plaster)
    outer = wall(-2.2, (-6.2, 0.2), 3.7, -9, windows) + wall(2.2, (-6.2, 0.2), 3.7, 9)
    outer += wall(-6.2, (-2.2, 2.2), 3.7, -9, axis="z") + wall(0.2, (-2.2, 2.2), 3.7, 9, axis="z")
    outer += [level((-2.2, 2.2), (-6.2, 0.2), 3.7)]
    for opening in windows:
        start, end, low, _ = opening
        outer += [*reveal((-2.2, -2), opening), level((-2.2, -2), (start, end), low)]
    glb.solid("outer walls", outer, stone)
    glb.solid("floor", [level((-2, 2), (-6, 0), 0)], stone)
    glb.solid("pews", [side for z in (-4.2, -2.6) for side in box((0.3, 0, z), (1.7, 0.45, z + 0.4))], oak)
    colors = {
        "ruby": (0.9, 0.06, 0.06),
        "gold": (0.95, 0.65, 0.1),
        "cobalt": (0.06, 0.15, 0.9),
        "leaf": (0.1, 0.7, 0.15),
    }
    glass = {
        name: glb.material(f"{name} glass", color, doubleSided=True, **glb.transmission(0.9))
        for name, color in colors.items()
    }
    for start, end, low, high in windows[:2]:
        middle, half = (start + end) / 2, (low + high) / 2
        for name, z, y in zip(
            colors, [(start, middle), (middle, end)] * 2, [(low, half)] * 2 + [(half, high)] * 2, strict=True
        ):
            pane = [upright(-2.1, *p) for p in ((z[0], y[0]), (z[1], y[0]), (z[1], y[1]), (z[0], y[1]))]
            glb.solid(f"{name} pane", [facing(pane, (0, 1, -3))], glass[name])
    curtain = glb.material("curtain", (0.85, 0.8, 0.75), alpha=0.6, alphaMode="BLEND", doubleSided=True)
    start, end, low, high = windows[2][0] - 0.2, windows[2][1] + 0.2, 0.1, 3.0
    sheet = [upright(-1.9, *p) for p in ((start, low), (end, low), (end, high), (start, high))]
    glb.solid("curtain", [facing(sheet, (0, 1, -3))], curtain)
    down_from_the_left = (-0.4239047, -0.4922765, -0.0000000, 0.7602425)
    glb.light("sun", [-4, 4, -3], down_from_the_left, type="directional", color=[1, 0.95, 0.88], intensity=25)
    glb.camera("nave", (1.6, 1.7, -0.4), (-1.1, 0.8, -4.0), 1.25)
    return glb


def conservatory() -> Glb:
    """A room of 6 x 2.8 x 4 m whose front is twelve clear panes in frames, in the sun, which shines through them."""
    glb = Glb()
    plaster, tile = glb.material("plaster", (0.75, 0.72, 0.68)), glb.material("tile", (0.55, 0.35, 0.28))
    wood, frame = glb.material("wood", (0.45, 0.28, 0.15)), glb.material("frame", (0.1, 0.12, 0.1))
    grass, sofa = glb.material("grass", (0.15, 0.3, 0.08)), glb.material("sofa", (0.5, 0.1, 0.1))
    glass = glb.material("glass", (0.95, 0.97, 0.96), doubleSided=True, **glb.transmission(0.92))
    height, sides, depth = 2.8, (-3, 3), (-4, 0)
    walls = wall(-3, depth, height, 0) + wall(3, depth, height, 0) + wall(-4, sides, height, 0, axis="z")
    glb.solid("walls", [*walls, level(sides, depth, height, down=True)], plaster)
    glb.solid("floor", [level(sides, depth, 0)], tile)
    glb.solid("roof", box((-3.2, height + 0.02, -4.2), (3.2, height + 0.2, 0.3)), plaster)
    bars = [side for x in range(-3, 4) for side in box((x - 0.04, 0, -0.04), (x + 0.04, height, 0.04))]
    bars += [side for y in (0.02, 1.4, 2.74) for side in box((-3, y, -0.035), (3, y + 0.06, 0.035))]
    glb.solid("frames", bars, frame)
    panes = [
        np.array([(x + 0.04, low, 0), (x + 0.96, low, 0), (x + 0.96, high, 0), (x + 0.04, high, 0)], float)
        for x in range(-3, 3)
        for low, high in ((0.08, 1.4), (1.46, 2.74))
    ]
    glb.solid("panes", panes, glass)
    glb.solid("lawn", [level((-30, 30), (0.05, 40), -0.05)], grass)
    glb.solid("table", table(0.6, -1.6), wood)
    glb.solid("sofa", box((-2.6, 0.05, -3.4), (-0.8, 0.45, -2.5)) + box((-2.6, 0.46, -3.4), (-0.8, 0.9, -3.1)), sofa)
    glb.solid("bowl", ball((0.6, 0.9, -1.6), 0.15), plaster)
    over_the_lawn = (-0.3840199, 0.2227253, 0.096005, 0.8909013)
    glb.light("sun", [0, 10, 10], over_the_lawn, type="directional", color=[1, 0.95, 0.85], intensity=3.5)
    glb.camera("inside", (2.6, 1.6, -0.4), (-1.5, 0.7, -3.2), 1.1)
    glb.camera("table", (-0.8, 1.5, -0.5), (0.7, 0.6, -1.9), 1.0)
    return glb


def furnace() -> Glb:
    """A closed box of albedo 0.5 whose walls emit 1: the radiance is 2 everywhere, and half of it is indirect light."""
    glb = Glb()
    wall = glb.material("wall", (0.5, 0.5, 0.5), **glb.emission(1))
    glb.solid("walls", box((-1, -1, -1), (1, 1, 1), inward=True), wall)
    glb.camera("inside", (0.2, 0.1, 0.7), (0, -0.2, -1), 1)
    return glb


def make_scenes() -> dict[str, bytes]:
    """The bytes of each file, by file name."""
    makers = (cornell, cornell_emissive, two_rooms, house, gaps, cells, corridor, metals, chapel, conservatory, furnace)
    return {f"{maker.__name__}.glb": maker().encode() for maker in makers}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, data in make_scenes().items():
        (FOLDER / name).write_bytes(data)
        print(f"{name}: {len(data)} bytes")
