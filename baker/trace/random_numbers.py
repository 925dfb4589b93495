"""Counter-based random numbers of the path tracer: any number of any path can be computed on its own.

A path therefore makes the same decisions for any limit on its length, and results do not depend on how points are
grouped.
"""

from .mitsuba_scene import load_mitsuba

mi = load_mitsuba()

# Additive recurrences in 32-bit fixed point: 1 / golden ratio; its two-dimensional counterpart R2 (Roberts 2018), from
# the root of x^3 = x + 1; and 1 / y, 1 / y^2 from the root of y^3 = y^2 + 1, which is as even and unrelated to R2.
GOLDEN = 2654435769
R2 = (3242174889, 2447445414)
Y2 = (2930575603, 1999613215)
DIRECTION = 0  # the dimension that steps by R2; other pairs step by Y2, so that neither depends on the other

# The others: which random number each decision uses. Some use the next one as well.
ROULETTE, LIGHT, EMITTER, EMITTER_POINT, ENVIRONMENT = 2, 3, 4, 5, 7
TEXTURE = 9  # and the next five, two for each kind of texture
FILTER, PLACE, BRIGHT, CANDIDATE = 15, 16, 17, 18

DIMENSIONS = 20  # most numbers that one bounce may use


def hashed(x):
    """A 32-bit integer hash (PCG RXS-M-XS; Jarzynski and Olano 2020)."""
    state = x * 747796405 + 2891336453
    word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737
    return (word >> 22) ^ word


class Draws:
    """The numbers of one bounce of one path per lane. `point` is the key of a point, `sample` counts all its paths.

    On bounce 0 the paths of a point cover the unit interval evenly, and so do any consecutive ones of them: they are a
    Kronecker sequence with a random shift per key (Cranley and Patterson 1976). On later bounces the numbers are
    independent.
    """

    def __init__(self, point, sample, bounce):
        self.point, self.sample, self.bounce = point, sample, bounce
        self.path = hashed(point + sample * GOLDEN)

    def one(self, dimension: int):
        """Float in [0, 1)."""
        return _unit(self._word(dimension, GOLDEN))

    def rest(self, dimension: int):
        """The bits that `one` lacks, as a Float in [0, 1)."""
        return mi.Float(self._word(dimension, GOLDEN) & 255) * (1 / 256)

    def two(self, dimension: int):
        """Point2f in [0, 1)^2; uses `dimension` and the next one."""
        steps = R2 if dimension == DIRECTION else Y2
        return mi.Point2f(*(_unit(self._word(dimension + i, step)) for i, step in enumerate(steps)))

    def independent(self, dimension: int):
        """The same as `two`, but independent on every bounce.

        For decisions that depend on what another `two` of the same bounce has found.
        """
        return mi.Point2f(*(_unit(self._free(dimension + i)) for i in range(2)))

    def _word(self, dimension: int, step: int):
        import drjit as dr

        even = hashed(self.point + (dimension * 0x85EBCA6B & 0xFFFFFFFF)) + self.sample * step
        return dr.select(self.bounce == 0, even, self._free(dimension))

    def _free(self, dimension: int):
        return hashed(self.path ^ hashed(self.bounce * DIMENSIONS + dimension))


def _unit(word):
    return mi.Float(word >> 8) * (1 / (1 << 24))
