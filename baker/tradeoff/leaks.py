"""What each method leaks into the dark, at the same dark points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsgi.baker.evaluation.leak import Reach, Surroundings, leak
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.gaussians import Bake

from .ground import Ground


@dataclass
class DarkPoints:
    """The surroundings of one view. What is dark there is found once, since it does not depend on the method."""

    around: Surroundings
    bright: np.ndarray | None = None

    def bright_side(self, position: np.ndarray, normal: np.ndarray, light: np.ndarray) -> np.ndarray:
        """As Surroundings has it, for the points of the first call."""
        if self.bright is None:
            self.bright = self.around.bright_side(position, normal, light)
        return self.bright

    def leak(self, image: np.ndarray, reference: Reference) -> float | None:
        """The share of `evaluation.leak` in B (H, W, 3); None if hardly any point is dark."""
        return leak(image, reference, self)


def dark_points(ground: Ground, baked: Bake) -> Sequence[DarkPoints]:
    """Those of each reference: points are dark beside light within the reach of the default bake's Gaussians."""
    references = list(ground.references.values())
    around = Surroundings.of(references, ground.plan.triangles, Reach(baked.gaussians))
    return [DarkPoints(around) for _ in references]
