"""Weights of a bake's light groups for the direct light of a pyrender scene."""

from collections.abc import Iterable

import numpy as np

from gsgi.runtime.gaussians import Bake
from gsgi.runtime.light_groups import Factors, factors_of, group_of, patterns_of


class Dimming:
    """The `factors` on the light of each group of a bake, which are 1 until they are set."""

    def __init__(self, bake: Bake | None):
        self._patterns = patterns_of(bake)
        self.factors: Factors = factors_of(bake, {}) if bake else {}

    def factor(self, names: Iterable[str]) -> np.ndarray:
        """The factor (3,) on the light of what has these names."""
        return np.array(self.factors[group_of(names, self._patterns)]) if self.factors else np.ones(3)
