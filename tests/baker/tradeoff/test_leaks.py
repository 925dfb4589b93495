"""What leaks into the dark: the dark points of a view are found once, for all methods."""

import numpy as np
import pytest

from gsgi.baker.evaluation.leak import DARK
from gsgi.baker.tradeoff.leaks import DarkPoints
from gsgi.baker.tradeoff.measure import score


class Lit:
    """Surroundings in which every point has the light 2 behind a wall."""

    asked = 0

    def bright_side(self, position, normal, light):
        self.asked += 1
        return np.full(len(position), 2.0)


def test_a_leak_is_relative_to_the_bright_side(ground):
    name, reference = next(iter(ground.references.items()))
    around = Lit()
    dark = DarkPoints(around)
    more = np.float32(2 * DARK)
    some, twice = (score(name, reference.clean + k * more, reference, ground.tone_scale, dark).leak for k in (1, 2))
    assert twice == pytest.approx(some + DARK, rel=1e-3)
    assert around.asked == 1
    assert score(name, reference.clean, reference, ground.tone_scale).leak is None
