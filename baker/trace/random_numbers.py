"""Counter-based random numbers of the path tracer: any number of any path can be computed on its own.

A path therefore makes the same decisions for any limit on its length, and results do not depend on how points are
grouped.
"""

from .mitsuba_scene import load_mitsuba

mi = load_mitsuba()

# Additive recurrences in 32-bit fixed point: 1 / golden ratio, and its two-dimensional counterpart R2 (Roberts 2018).
GOLDEN = 2654435769
R2 = (3242174889, 2447445414)

DIMENSIONS = 16  # most numbers that one bounce may use


def hashed(x):
    """A 32-bit integer hash (PCG RXS-M-XS; Jarzynski and Olano 2020)."""
    state = x * 747796405 + 2891336453
    word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737
    return (word >> 22) ^ word


class Draws:
    """The numbers of one bounce of one path per lane. `point` is the key of a point, `sample` counts its paths.

    On bounce 0 the paths of a point cover the unit interval evenly (a lattice with a random shift per point). On later
    bounces the numbers are independent.
    """

    def __init__(self, point, sample, bounce):
        self.point, self.sample, self.bounce = point, sample, bounce
        self.path = hashed(point + sample * GOLDEN)

    def one(self, dimension: int):
        """Float in [0, 1)."""
        return _unit(self._word(dimension, GOLDEN))

    def two(self, dimension: int):
        """Point2f in [0, 1)^2; uses `dimension` and the next one."""
        return mi.Point2f(*(_unit(self._word(dimension + i, step)) for i, step in enumerate(R2)))

    def _word(self, dimension: int, step: int):
        import drjit as dr

        even = hashed(self.point + (dimension * 0x85EBCA6B & 0xFFFFFFFF)) + self.sample * step
        free = hashed(self.path ^ hashed(self.bounce * DIMENSIONS + dimension))
        return dr.select(self.bounce == 0, even, free)


def _unit(word):
    return mi.Float(word >> 8) * (1 / (1 << 24))
