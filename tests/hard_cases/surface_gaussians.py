"""Gaussians and points that are hard for the `surface` operator."""

from dataclasses import replace

import numpy as np
import oracle
import scenes

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import SurfaceBlend

from .build import PINHOLE, gaussians, joined, moved, nobody, turned
from .case import Case, Tolerance
from .layers import ALL_SETS
from .surface import BLEND, DISTANCE, EVERYWHERE, surface_case

GROUP = "Gaussians"
SOFT = "softpipe"
UPSIDE_DOWN = turned(np.pi, (1, 0, 0))
COLOUR = 1, 2, 3


def case(name, build, *args, **kwargs) -> Case:
    return surface_case(GROUP, name, build, *args, **kwargs)


def on_wall(position=(0, 0, 0), scale=0.5, **changes):
    """Gaussians on the wall that the points are on, and that face the camera."""
    return gaussians(np.asarray(position, float) - (0, 0, DISTANCE), scale, **changes)


def everywhere(colour=(3, 2, 1), **changes):
    """A coarse Gaussian that reaches all points."""
    return on_wall(scale=50, colour=colour, opacity=1, **changes)


def tiles(edge: int = 8, **changes):
    """A grid of flat Gaussians on the wall, of many colours."""
    place = np.stack(np.meshgrid(np.linspace(-2, 2, edge), np.linspace(-1, 1, edge)), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(4)
    given = {
        "scale": (0.3, 0.3, 0.02),
        "colour": rng.uniform(0, 1, (edge**2, 3)),
        "opacity": rng.uniform(0.1, 1, edge**2),
    }
    return on_wall(np.column_stack([place, np.zeros(edge**2)]), **(given | changes))


def weighing(total: float):
    """Two Gaussians whose weights sum to `total` in the middle of the wall, and nearly that far around it."""
    opacity = total / (1 - BLEND.cutoff) / 2
    return on_wall(scale=1e3, opacity=[opacity, opacity], colour=[(1, 0, 0), (0, 1, 0)])


def too_long():
    """A Gaussian whose quaternion is none of a rotation."""
    return on_wall(rotation=(0.3, 0.6, 0.9, 0.99), scale=(1, 2, 0.5))


def lobes(sign: float):
    """A coarse Gaussian of SH degree 2 whose light along the normal is far below or above 0."""
    given = everywhere()
    sh = np.zeros((1, 9, 3), np.float32)
    sh[:, 0], sh[:, 2], sh[:, 6] = given.sh[:, 0], sign * 20, sign * 5
    return replace(given, sh=sh)


def sphere_of_normals():
    """A normal of its own at each point, all of them towards the camera."""
    rng = np.random.default_rng(6)
    normal = rng.normal(size=(PINHOLE.height, PINHOLE.width, 3))
    normal[..., 2] = np.abs(normal[..., 2])
    return (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)


def up_to_cutoff():
    """Depths at which the points before the middle row end, to a float, at the radius of a Gaussian."""
    depth = np.full((PINHOLE.height, PINHOLE.width), 2.0, np.float32)
    depth[8] = np.nextafter(np.float32(DISTANCE + 0.5 * BLEND.radius), np.float32([0, 9])[np.arange(33) % 2])
    return depth


BOTH = (nobody(), everywhere())
GREY = (1, 1, 1)
BY_SHADERS = "llvmpipe", "look-up"
HALF_BIT = Tolerance(1e-3, "B is stored in half floats, of 11 bits")

CASES = [
    case("none at all", lambda: nobody(), known=(0, 0, 0)),
    case("points that no Gaussian reaches", lambda: on_wall((0, 99, 0)), known=(0, 0, 0)),
    case("a coarse level alone", lambda: BOTH, (*EVERYWHERE, SOFT), known=(3, 2, 1)),
    case("one alone, without a coarse level", lambda: on_wall(colour=COLOUR)),
    case("tiles over a coarse level", lambda: (tiles(), everywhere()), (*EVERYWHERE, SOFT)),
    case("many of SH degree 2 over degree 1", lambda: (
        oracle.random_gaussians(200, 2, 5), oracle.random_gaussians(40, 1, 6)),
        pinhole=scenes.inside_camera().pinhole(33, 17), depth=1.5, normal=sphere_of_normals,
        tolerances=dict.fromkeys(ALL_SETS, Tolerance(1e-3, "negative and positive light cancel"))),
    case("scale zero", lambda: (on_wall((0.1, 0.05, 0), scale=0), everywhere())),
    case("flat, of thickness 0, in the plane of the points", lambda: on_wall(scale=(9, 9, 0), opacity=1, colour=COLOUR),
         holds="a scale below SCALE_MIN counts as SCALE_MIN", known=COLOUR),
    case("flat, of thickness 1e-12", lambda: on_wall(scale=(9, 9, 1e-12), opacity=1, colour=COLOUR), known=COLOUR),
    case("scale 1e6", lambda: on_wall(scale=1e6, opacity=1, colour=COLOUR), known=COLOUR),
    case("scale 1e18", lambda: on_wall(scale=1e18, opacity=1, colour=COLOUR), known=COLOUR),
    case("the largest float as scale", lambda: on_wall(scale=3e38, opacity=1, colour=COLOUR), known=COLOUR),
    *[
        case(f"needle of aspect 1e4 {name}", lambda turn=turn: (
            on_wall(scale=(2, 2e-4, 2e-4), rotation=turn, opacity=1, colour=COLOUR), everywhere()))
        for name, turn in (("along the wall", turned(0.0)), ("across it", turned(np.pi / 2)),
                           ("aslant", turned(0.7)), ("towards the view", turned(np.pi / 2, (0, 1, 0))))
    ],
    case("needles that fill the wall", lambda: on_wall(
        np.column_stack([np.zeros(900), np.linspace(-1.3, 1.3, 900), np.zeros(900)]), (20, 2e-3, 2e-3), colour=COLOUR)),
    case("zero quaternion", lambda: on_wall(rotation=0, scale=(1, 2, 0.5)), holds="it is no turn"),
    case("a quaternion of length 1.5", too_long, tuple(layer for layer in EVERYWHERE if layer not in BY_SHADERS)),
    case("a quaternion of length 1.5 in a shader", too_long, BY_SHADERS, "refused, naming the Gaussian",
         refused=(UnsupportedError, "^Gaussian 0: .* length 1.5")),
    case("opacity 0", lambda: on_wall(opacity=0, scale=9), known=(0, 0, 0)),
    case("opacity 1e-6 over a coarse level", lambda: (on_wall(opacity=1e-6, scale=9), everywhere())),
    case("opacity just under 1", lambda: on_wall(opacity=np.nextafter(np.float32(1), 0), scale=9)),
    case("a coarse level of opacity 1/255", lambda: (nobody(), on_wall(scale=50, opacity=1 / 255, colour=COLOUR)),
         known=COLOUR),
    case("centre on the eye", lambda: on_wall((0, 0, DISTANCE), scale=3)),
    case("centre behind the eye", lambda: on_wall((0.3, 0, DISTANCE + 1), scale=4)),
    case("across the near plane", lambda: on_wall((0.1, 0, DISTANCE - 0.01), scale=(0.5, 0.5, 3))),
    case("far outside the frustum with a huge extent", lambda: on_wall((40, 10, 0), scale=30)),
    case("a point exactly at the cut-off", lambda: on_wall(scale=(9, 9, 0.5)), depth=up_to_cutoff),
    case("weights just below the floor", lambda: (weighing(BLEND.floor * (1 - 1e-6)), everywhere())),
    case("weights just above the floor", lambda: (weighing(BLEND.floor * (1 + 1e-6)), everywhere())),
    case("opposite normals on a thin sheet", lambda: joined(
        on_wall(scale=9, colour=(1, 0, 0)), on_wall((0, 0, -1e-4), 9, rotation=UPSIDE_DOWN, colour=(0, 1, 0))),
        known=(1, 0, 0)),
    case("normals at right angles to a Gaussian's", lambda: (on_wall(scale=9), everywhere()), normal=(1.0, 0, 0),
         known=(3, 2, 1)),
    case("sharpness 64", lambda: (tiles(), everywhere()), blend=SurfaceBlend(sharpness=64), normal=sphere_of_normals),
    case("a cut-off of 0.999", lambda: (tiles(), everywhere()), blend=SurfaceBlend(cutoff=0.999)),
    case("a cut-off of 1e-30", lambda: (tiles(), everywhere()), blend=SurfaceBlend(cutoff=1e-30)),
    case("a floor of 1e6", lambda: (tiles(), everywhere()), blend=SurfaceBlend(floor=1e6)),
    case("a floor of 1e-30", lambda: on_wall(scale=9, opacity=1e-20, colour=COLOUR),
         blend=SurfaceBlend(floor=1e-30)),
    case("negative SH lobes", lambda: (nobody(), lobes(-1)), known=(0, 0, 0)),
    case("positive SH lobes", lambda: (nobody(), lobes(1))),
    case("the steepest slopes", lambda: on_wall(scale=1, slope=(0.49, -0.49)), normal=(0, 0, 1.0)),
    case("black", lambda: on_wall(colour=0, scale=9), known=(0, 0, 0)),
    case("light of 1e-6", lambda: on_wall(colour=1e-6, scale=9, opacity=1), known=(1e-6,) * 3, tolerances={
        "llvmpipe": Tolerance(0.05, "half floats have steps of 6e-8 there")}),
    case("light of 1e6", lambda: on_wall(colour=1e6, scale=9, opacity=1), known=(1e6,) * 3,
         holds="OpenGL clamps it to the largest half float"),
    case("two exactly coincident", lambda: on_wall(scale=9, colour=[(1, 0, 0), (0, 1, 0)]), known=(0.5, 0.5, 0)),
    case("sums of 1e5 weights", lambda: on_wall(np.zeros((100_000, 3)), 9, colour=COLOUR, opacity=0.7),
         tuple(layer for layer in EVERYWHERE if layer not in ("file", "C")),
         pinhole=PINHOLE._replace(width=4, height=3),
         alike=lambda: on_wall(scale=9, colour=COLOUR), tolerances=dict.fromkeys(
             (*ALL_SETS, *BY_SHADERS, "sample", "gradient, float"),
             Tolerance(6e-3, "1e5 terms, each rounded: 1e5 x 2^-24"))),
    case("smaller than a pixel, over a coarse level", lambda: (tiles(40, scale=0.005), everywhere())),
    case("1e5 m from the origin", lambda: (_at(tiles(), 1e5), _at(everywhere(), 1e5)),
         pinhole=moved(PINHOLE, [1e5] * 3)),
    case("a millimetre scene", lambda: (_scaled(tiles(), 1e-3), _scaled(everywhere(), 1e-3)), depth=DISTANCE * 1e-3),
    case("a kilometre scene", lambda: (_scaled(tiles(), 1e3), _scaled(everywhere(), 1e3)), depth=DISTANCE * 1e3),
]  # fmt: skip


def _scaled(given, factor: float):
    return replace(given, position=given.position * np.float32(factor), scale=given.scale * np.float32(factor))


def _at(given, offset: float):
    return replace(given, position=(given.position.astype(float) + offset).astype(np.float32))
