"""How the `surface` operator spends a budget: Gaussians of its two levels, and samples to fit them to."""

import math

from gsgi.runtime.file import codec

FINE_DEGREE = 0  # B hardly depends on the normal where one Gaussian's surface is
COARSE_DEGREE = 2  # irradiance is smooth in the normal (Ramamoorthi and Hanrahan 2001)

COARSE_SHARE, COARSE_MOST = 4, 1024  # one coarse Gaussian for so many, but no more than this

# Samples that tell the shapes of a Gaussian and its neighbours apart; and so many in all at least, which cost next to
# nothing, and at most.
SAMPLES_PER_GAUSSIAN, SAMPLES_FEWEST, SAMPLES_MOST = 64, 1 << 17, 1 << 20
FREE_PER_GAUSSIAN = 256  # in free space, for each coarse Gaussian: it has nine coefficients, normals are all directions

# What the samples that one Gaussian sees may miss of its light: a fit follows noise that is larger.
NOISE = 0.007
PATHS_STEP, PATHS_MOST = 64, 1024  # per sample, both halves together


def coarse_count(budget: int) -> int:
    """Gaussians of the coarse level, one at least; the others are fine."""
    return min(max(budget // COARSE_SHARE, 1), COARSE_MOST)


def sample_count(budget: int) -> int:
    """Surface samples that are traced."""
    return min(max(SAMPLES_PER_GAUSSIAN * budget, SAMPLES_FEWEST), SAMPLES_MOST)


def free_count(budget: int) -> int:
    """Samples that are traced in free space."""
    return FREE_PER_GAUSSIAN * coarse_count(budget)


def path_count(budget: int, noise: float) -> int:
    """Paths of each sample, where those of one path have a standard deviation of `noise` times the light."""
    wanted = (noise / NOISE) ** 2 * budget / sample_count(budget)
    return min(max(math.ceil(wanted / PATHS_STEP), 1) * PATHS_STEP, PATHS_MOST)


def file_bytes(budget: int) -> int:
    """Size of a file with so many Gaussians."""
    coarse = coarse_count(budget)
    return codec.file_bytes(budget - coarse, FINE_DEGREE, coarse, COARSE_DEGREE)
