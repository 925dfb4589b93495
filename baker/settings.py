"""What a bake may cost: the defaults of the command line and of the Python call."""

from dataclasses import dataclass
from typing import NamedTuple

# What a bake can leave out, by the name that the command line has for it.
EFFECTS = ("punctual", "emissive", "environment", "alpha-mask", "double-sided", "normal-map", "unlit")


OPERATORS = ("surface", "over")


class Quality(NamedTuple):
    """A preset of the dial: `gaussians` for each that the scene's detail calls for, and steps of the fit, so many of
    each view and so many at least."""

    gaussians: float
    visits: int
    steps: int


# Most Gaussians of a bake: 9 MB. A fit starts from an eighth of that and doubles three times at most.
BUDGET_MAX = 1 << 19

QUALITIES = {
    "over": {"draft": Quality(1 / 4, 6, 1500), "medium": Quality(1, 12, 4000), "high": Quality(4, 24, 12000)},
    "surface": {"draft": Quality(1 / 16, 0, 80), "medium": Quality(1 / 4, 0, 150), "high": Quality(1, 0, 300)},
}

SAMPLES = 256  # most paths per pixel of a view


@dataclass(frozen=True)
class Settings:
    """What a bake may cost. None leaves a number to the plan.

    operator: one of OPERATORS. quality: a name of QUALITIES[operator]. budget: most Gaussians, None: by quality.
    target_loss: the fewest Gaussians that reach this loss in views that are not fitted are searched for, within the
    budget (None: that of high quality). size: edge of a view, px. samples: paths per sample of a surface, or most paths
    per pixel of a view: there, fewer are taken where the standard error of B is below `error` * (B + its mean) before.
    bounces: surfaces that a path may visit after the point; None: so many that further ones add less than
    `bounce_fraction` of the picture. ignore: effects (of EFFECTS) that the bake leaves out.
    """

    operator: str = "surface"
    quality: str = "medium"
    budget: int | None = None
    target_loss: float | None = None
    views: int | None = None
    size: int | None = None
    samples: int | None = None
    error: float = 0.1
    bounces: int | None = None
    bounce_fraction: float = 0.005
    iterations: int | None = None
    denoise: bool = True
    ignore: tuple[str, ...] = ()
    seed: int = 0
