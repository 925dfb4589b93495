"""Gaussians of extreme size, shape, opacity and place."""

from dataclasses import replace

import numpy as np
import oracle
import scenes

from gsgi.runtime.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from gsgi.runtime.gaussians import OverBlend

from .build import PINHOLE, gaussians, moved, nobody, turned
from .case import Case, Tolerance
from .layers import ALL_SETS
from .over import EVERYWHERE as OVER
from .over import over_case
from .surface import surface_case

GROUP = "Gaussians"
SOFT = "softpipe"
GRADIENTS = "gradient, double", "gradient, float"
# A gradient loses the square of the ratio of the axes on the image: nothing is left of float32 at 1e7.
IMAGES = tuple(layer for layer in OVER if layer not in GRADIENTS)


def over(name, build, *args, **kwargs) -> Case:
    return over_case(GROUP, name, build, *args, **kwargs)


def surface(name, build, *args, **kwargs) -> Case:
    return surface_case(GROUP, name, build, *args, **kwargs)


def random(count: int, seed: int, degree: int = 0):
    return oracle.random_gaussians(count, degree, seed)


def stack(count: int, **changes):
    """Gaussians of many colours one behind the other."""
    rng = np.random.default_rng(1)
    given = {"position": np.column_stack([np.zeros((count, 2)), -np.linspace(1, 4, count)])}
    return gaussians(**(given | {"opacity": 0.02, "scale": 0.3, "colour": rng.uniform(0, 1, (count, 3))} | changes))


def specks(count: int = 100):
    """Smaller than a pixel, on a wall."""
    rng = np.random.default_rng(2)
    place = np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), np.full(count, -1.0)])
    return gaussians(place, 1e-4, colour=rng.uniform(0, 1, (count, 3)))


INSIDE = scenes.inside_camera().pinhole(48, 40)
WHITE = (1, 1, 1)

CASES = [
    over("fifty of SH degree 3", lambda: random(50, 3, 3), (*OVER, SOFT), pinhole=INSIDE),
    over("none", lambda: nobody(), known=(0, 0, 0)),
    over("one alone", gaussians, (*OVER, SOFT)),
    over("scale zero", lambda: gaussians(scale=0)),
    over("scale zero without dilation", lambda: gaussians(scale=0), blend=OverBlend(0.01, 0.0), known=(0, 0, 0)),
    over("scale 1e-12", lambda: gaussians(scale=1e-12)),
    over("the smallest float as scale", lambda: gaussians(scale=1e-45)),
    over("scale 1e6", lambda: gaussians(scale=1e6, opacity=0.5), known=(0.5, 1, 1.5)),
    over("scale 1e6 along one axis", lambda: gaussians(scale=(1e6, 0.01, 0.01), rotation=turned(0.4)), IMAGES),
    over("scale 1e-12 along one axis", lambda: gaussians(scale=(0.1, 1e-12, 0.1), rotation=turned(0.4))),
    over("the largest float as scale", lambda: gaussians(scale=3e38), known=(0, 0, 0), holds="all layers drop it"),
    over("a giant needle", lambda: gaussians(scale=(1e6, 1e-6, 1e-6), rotation=turned(np.pi / 4)), IMAGES),
    *[
        over(f"needle of aspect 1e4 at {angle} degrees", lambda angle=angle: gaussians(
            (0.05, 0.02, -1), (1, 1e-4, 1e-4), turned(np.radians(angle)), 0.99))
        for angle in (0, 6, 45, 84, 90, 135)
    ],
    over("needle of aspect 1e4 towards the view", lambda: gaussians(scale=(1e-4, 1e-4, 1), position=(0.2, 0.1, -1.5))),
    over("needle of aspect 1e9 towards the view", lambda: gaussians(scale=(1e-6, 1e-6, 1e3))),
    over("zero quaternion", lambda: gaussians(rotation=0, scale=(0.2, 0.1, 0.05)), holds="it is no turn"),
    over("a quaternion of length 1.5", lambda: gaussians(rotation=(0.3, 0.6, 0.9, 0.95), scale=(0.2, 0.1, 0.05))),
    over("a quaternion of length 1e30", lambda: gaussians(rotation=np.full(4, 5e29)), IMAGES, known=(0, 0, 0),
         holds="all layers drop it; a file normalises it"),
    over("opacity -1", lambda: gaussians(opacity=-1), IMAGES, known=(0, 0, 0)),
    over("opacity 0", lambda: gaussians(opacity=0), known=(0, 0, 0)),
    over("opacity 1", lambda: gaussians(opacity=1, scale=1e3), known=tuple(ALPHA_MAX * k for k in (1, 2, 3))),
    over("opacity just under 1", lambda: gaussians(opacity=np.nextafter(np.float32(1), 0))),
    over("opacity at alpha_min", lambda: gaussians(opacity=np.float32(0.00392156863) * np.float32(1.001))),
    over("opacity under alpha_min", lambda: gaussians(opacity=0.0039, scale=1e3), known=(0, 0, 0)),
    over("centre on the eye", lambda: gaussians((0, 0, 0)), known=(0, 0, 0)),
    over("centre on the eye, near plane at 0", lambda: gaussians((0, 0, 0)), blend=OverBlend(0.0), known=(0, 0, 0)),
    over("centre on the near plane", lambda: gaussians((0.1, 0, -1)), blend=OverBlend(1.0)),
    over("centre just before the near plane", lambda: gaussians((0.1, 0, -0.999)), blend=OverBlend(1.0),
         known=(0, 0, 0)),
    over("extent across the near plane", lambda: gaussians((0.1, 0, -0.011), 0.3), known=None),
    over("just before the eye", lambda: gaussians((0, 0, -1e-30)), blend=OverBlend(0.0)),
    over("beside the eye", lambda: gaussians((1, 1, -1e-30), 1), blend=OverBlend(0.0), known=(0, 0, 0)),
    over("behind the eye", lambda: gaussians((0, 0, 1), 5), known=(0, 0, 0)),
    over("far outside the frustum with a huge extent", lambda: gaussians((50, 20, -3), 30)),
    over("at 1e30 m with a scale of 1e29 m", lambda: gaussians((0, 0, -1e30), 1e29)),
    over("1e5 m from the origin", lambda: gaussians((1e5, 1e5, -1e5 - 1), 0.25),
         pinhole=moved(PINHOLE, (1e5, 1e5, -1e5))),
    over("a millimetre scene", lambda: _scaled(random(50, 5), 1e-3), pinhole=moved(INSIDE, (0, 0, 0)),
         blend=OverBlend(1e-5)),
    over("a kilometre scene", lambda: _scaled(random(50, 5), 1e3), pinhole=moved(INSIDE, (0, 0, 0)),
         blend=OverBlend(10.0)),
    over("black", lambda: gaussians(colour=0), known=(0, 0, 0)),
    over("colours of 1e-6", lambda: gaussians(colour=1e-6, opacity=0.5, scale=1e3), known=(5e-7,) * 3, tolerances={
        "llvmpipe": Tolerance(0.1, "half floats end at 6e-8")}),
    over("colours of 1e30", lambda: gaussians(colour=1e30, scale=1e3, opacity=0.5), known=(5e29,) * 3),
    over("two exactly coincident", lambda: gaussians(colour=[(1, 0, 0), (0, 1, 0)], opacity=0.5),
         holds="the first in the file is in front"),
    over("a hundred opaque at one place", lambda: gaussians(np.tile((0, 0, -1.0), (100, 1)), opacity=1.0),
         tolerances=dict.fromkeys(("torch", "double", *ALL_SETS, *GRADIENTS), Tolerance(
             2 * TRANSMITTANCE_MIN, "two opaque layers leave TRANSMITTANCE_MIN: rounding decides of a third"))),
    over("1e5 at equal depth", lambda: gaussians(np.tile((0, 0, -1.0), (100_000, 1)), 1e3, opacity=0.01, colour=WHITE),
         tuple(layer for layer in OVER if layer not in ("torch", "file", *GRADIENTS)),
         alike=gaussians(np.tile((0, 0, -1.0), (1000, 1)), 1e3, opacity=0.01, colour=WHITE)),
    over("300 layers on one pixel", lambda: stack(300)),
    over("3,000 layers on one pixel", lambda: stack(3000, opacity=0.005), IMAGES),
    over("smaller than a pixel", specks, (*OVER, SOFT)),
]  # fmt: skip


def _scaled(given, factor: float):
    return replace(given, position=given.position * np.float32(factor), scale=given.scale * np.float32(factor))
