"""Gaussians: our bakes with both operators, over budgets and resolutions of the pass."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend
from gsgi.runtime.sampling import sample

from .ground import Ground
from .method import Method

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.gaussian_light import GaussianLight

FACTORS = 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8  # of the budget of the default bake
FACTORS_QUICK = 1 / 16, 1 / 4, 1, 4
FACTORS_OVER = 1 / 8, 1 / 2, 2, 8  # of the budget of a draft, which has 1,200 Gaussians in a Cornell box
FACTORS_OVER_QUICK = 1 / 4, 1
FEWEST = 16
PATHS = 1 / 16, 1 / 4, 2  # times the paths of the default bake
TEXEL_BYTES = 16  # RGBA32F
SHAPE_TEXELS = 3


@dataclass(frozen=True)
class BakedGaussians:
    """`data` (B,) uint8 are the bytes of a .gsgi file."""

    data: np.ndarray

    @property
    def bake(self) -> Bake:
        """The file's content."""
        return codec.decode(self.data.tobytes())

    @property
    def file_bytes(self) -> int:
        """Size of the file."""
        return len(self.data)

    @property
    def gpu_bytes(self) -> int:
        """Texels that hold Gaussians, without the padding of the last row, and their index."""
        return sum(_gpu_bytes(level) for level in (self.bake.gaussians, self.bake.coarse) if level is not None)

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
        """B (N, 3) of what moves at points (N, 3) with unit normals (N, 3); None with `over`: it lights no points."""
        bake = self.bake
        return None if isinstance(bake.blend, OverBlend) else sample(bake, position, normal, free=True)

    def light_pass(self, frame: "Frame", scale: int) -> "GaussianLight":
        """The runtime's own pass."""
        from .gl.gaussian_light import GaussianLight

        return GaussianLight(frame, self.bake, scale)


@dataclass(frozen=True)
class BakedSurface(BakedGaussians):
    """The same with both levels as they were before they were encoded."""

    fine: Gaussians
    coarse: Gaussians

    @property
    def exact(self) -> Bake:
        """What the file would hold if it held floats."""
        return replace(self.bake, gaussians=self.fine, coarse=self.coarse)


def bake_surface(ground: Ground, value: float, progress: Progress) -> BakedSurface:
    """Bake with a budget of `value` Gaussians, as `gsgi bake --budget` does."""
    from gsgi.baker.bake import Baker

    plan = replace(ground.plan, settings=replace(ground.plan.settings, budget=int(value)), by_light=False)
    progress.seconds.update(ground.plan_seconds)
    baker = Baker(plan, progress)
    data = np.frombuffer(baker.best().data, np.uint8)
    exact = baker.baked[plan.settings.budget]
    return BakedSurface(data, exact.gaussians, exact.coarse)


def bake_over(ground: Ground, value: float, progress: Progress) -> BakedGaussians:
    """Bake with a budget of `value` Gaussians, as `gsgi bake --operator over --budget` does; quick ones are drafts."""
    from gsgi.baker.bake import bake

    quality = "draft" if ground.quick else "medium"
    settings = replace(ground.settings, operator="over", quality=quality, budget=int(value))
    plan, seconds = ground.planned(settings)
    progress.seconds.update(seconds)
    return BakedGaussians(np.frombuffer(bake(plan, progress).data, np.uint8))


def surface_budgets(ground: Ground) -> list[float]:
    """Budgets around that of the default bake, over two orders of magnitude."""
    return _budgets(ground.plan.settings.budget, FACTORS_QUICK if ground.quick else FACTORS)


def over_budgets(ground: Ground) -> list[float]:
    """Budgets around that of a draft, which has as many Gaussians as our default bake."""
    return _budgets(ground.plan.settings.budget, FACTORS_OVER_QUICK if ground.quick else FACTORS_OVER)


def _budgets(middle: int, factors: tuple[float, ...]) -> list[float]:
    return sorted({float(max(round(factor * middle), FEWEST)) for factor in factors})


def _gpu_bytes(level: Gaussians) -> int:
    sh_texels = -(-3 * level.sh.shape[1] // 4)
    return len(level) * (TEXEL_BYTES * (SHAPE_TEXELS + sh_texels + level.sloped) + 4)


SURFACE = Method(
    "surface", "Gaussians, read at surfaces", "this project",
    "What `gsgi bake` makes, with the budget as its only flag.", "Gaussians", BakedSurface, surface_budgets,
    bake_surface, scales=(1, 2, 4), paths=PATHS, in_space=True,
)  # fmt: skip
OVER = Method(
    "over", "Gaussians, blended", "Zubatov et al.; Kerbl et al. 2023",
    "What `gsgi bake --operator over` makes, with the budget as its only other flag (--quick: drafts).", "Gaussians",
    BakedGaussians, over_budgets, bake_over,
)  # fmt: skip
