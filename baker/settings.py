"""The settings of a bake, with the defaults of the command line and of the Python API."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

from gsgi.runtime.errors import UsageError

# The effects that a bake can leave out, by their names on the command line.
EFFECTS = ("punctual", "emissive", "environment", "alpha-mask", "double-sided", "normal-map", "unlit")


OPERATORS = ("surface", "over")
METALS = ("rough", "black")  # how metals reflect: diffusely, as rough ones would on average, or not at all


class Quality(NamedTuple):
    """A preset between accuracy and cost.

    `gaussians` is a factor on the number of Gaussians that the scene's detail calls for. The fit takes `visits` steps
    per view, and at least `steps` in all.
    """

    gaussians: float
    visits: int
    steps: int


# Most Gaussians of a bake: 11 MB. With `over`, a fit starts from at most an eighth of that.
BUDGET_MAX = 1 << 19

QUALITIES = {
    "over": {"draft": Quality(1 / 4, 6, 1500), "medium": Quality(1, 12, 4000), "high": Quality(4, 24, 12000)},
    "surface": {"draft": Quality(0.9 / 16, 0, 300), "medium": Quality(0.9 / 4, 0, 300), "high": Quality(0.9, 0, 300)},
}

SAMPLES = {"over": 256, "surface": 512}  # most paths per pixel of a view, or per surface sample
LEAST = {"budget": 1, "views": 1, "size": 1, "samples": 1, "bounces": 0, "iterations": 0}

# Of the picture, by bounces beyond the last. With `surface` most paths end at the next surface in light that few paths
# have traced: bounces cost little, and 0.005 made the darker of two rooms 1.6 % too dark.
BOUNCE_FRACTION = {"over": 0.005, "surface": 0.0005}

ERROR = {"over": 0.1, "surface": 0.05}  # noise at which they take no more, relative to the light


@dataclass(frozen=True)
class Settings:
    """The settings of a bake. None leaves a number to the plan.

    operator: one of OPERATORS. quality: a name of QUALITIES[operator]. budget: most Gaussians; None: by quality.
    target_loss: search for the fewest Gaussians that reach this loss in held-out views, within the budget (None: that
    of high quality). size: edge of a view, px. samples: most paths per pixel of a view, or per surface sample. A pixel
    takes fewer if the standard error of B is below `error` * (B + its mean) earlier, a surface sample if it is below
    `error` * the mean B of its neighbours; with `error` 0 all are traced. Where paths are connected to lit places, a
    surface sample takes at most half of them. bounces: surfaces that a path may visit after the point; None:
    enough that further ones add less than `bounce_fraction` of the picture.
    ignore: effects (of EFFECTS) that the bake leaves out. metals: how metals reflect, one of METALS. Raises UsageError
    for an unknown operator, quality, effect or way to reflect, and for a number that is too small.
    """

    operator: str = "surface"
    quality: str = "medium"
    budget: int | None = None
    target_loss: float | None = None
    views: int | None = None
    size: int | None = None
    samples: int | None = None
    error: float | None = None
    bounces: int | None = None
    bounce_fraction: float | None = None
    iterations: int | None = None
    denoise: bool = True
    ignore: tuple[str, ...] = ()
    metals: str = "rough"
    seed: int = 0

    def __post_init__(self):
        _check("operator", self.operator, OPERATORS)
        _check("quality", self.quality, QUALITIES[self.operator])
        _check("metals", self.metals, METALS)
        for effect in self.ignore:
            _check("ignore", effect, EFFECTS)
        for field, least in LEAST.items():
            value = getattr(self, field)
            if value is not None and not value >= least:
                raise UsageError(f"{field}: expected at least {least}, got {value!r}")


def _check(field: str, word: str, words: Collection[str]) -> None:
    if word not in words:
        raise UsageError(f"{field}: expected one of {', '.join(words)}, got {word!r}")
