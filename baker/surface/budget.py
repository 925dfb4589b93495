"""How the `surface` operator spends a budget: the Gaussians of its two levels, and the samples to fit them to."""

from gsgi.baker.trace.tracer import PASS_SAMPLES
from gsgi.runtime.file import codec

FINE_DEGREE = 0  # B hardly depends on the normal on the surface of one Gaussian
FINE_BASIS = "linear"  # two slopes for all channels: six, one pair each, gained less than their bytes
COARSE_DEGREE = 2  # irradiance is smooth in the normal (Ramamoorthi and Hanrahan 2001)

COARSE_SHARE, COARSE_MOST = 4, 1024  # one Gaussian in COARSE_SHARE is coarse, up to COARSE_MOST

# Surface samples per Gaussian: enough to tell its shape from those of its neighbours. The total has a lower limit,
# since with half of it a room of metres had dark dashes in gaps of centimetres, such as behind a wardrobe. It does not
# grow beyond SAMPLES_MANY as long as each Gaussian has SAMPLES_LEAST: with fewer than those, more Gaussians have more
# error.
SAMPLES_PER_GAUSSIAN, SAMPLES_LEAST, SAMPLES_FEWEST, SAMPLES_MANY = 64, 32, 1 << 16, 1 << 20
FREE_PER_GAUSSIAN = 256  # samples in free space per coarse Gaussian: nine coefficients, normals in all directions

# A sample in free space takes a further layer, up to so many, where the noise around it is more than this share of the
# light: its paths are not guided. Two layers took a fifth off the error of the light of things that move in an attic
# and a breakfast room, for a thirtieth of the time; four a third, for a seventh.
FREE_LAYERS, FREE_ERROR = 2, 0.15

# Points of the last round of light in which paths end, for each Gaussian that a scene's shapes call for: any quality
# has the same, so that none traces what another has left in the cache. The round before has half of them. With half as
# many, a hall with hollow columns had twice the leaks, and a fifth more mottle.
KNOWN_PER_GAUSSIAN, KNOWN_MOST = 12, 1 << 17

PATHS_STEP = 2 * PASS_SAMPLES  # per sample: one pass of each half

# Where paths are connected to lit places (see `baker.trace.lit_places`), a path has about so much noise, relative to
# one that is not, and this share of the paths is enough.
CONNECTED_PATHS, CONNECTED_NOISE = 1 / 2, 1 / 2

# Steps of a fit after an edit, as a share of all. Twice as many and larger ones changed the SSIM of frames by 0.0003 at
# most, after a chair or all furniture of a house had moved.
EDITED_STEPS = 0.05

# Noise of a guided path, relative to one that is not, about: 0.55 in a room lit through windows, 0.95 in a hall.
GUIDED_NOISE = 0.8


def coarse_count(budget: int) -> int:
    """Gaussians of the coarse level, at least one; the rest of the budget is for the fine level."""
    return min(max(budget // COARSE_SHARE, 1), COARSE_MOST)


def sample_count(budget: int) -> int:
    """Number of surface samples to trace."""
    most = max(SAMPLES_MANY, SAMPLES_LEAST * budget)
    return min(max(SAMPLES_PER_GAUSSIAN * budget, SAMPLES_FEWEST), most)


def free_count(budget: int) -> int:
    """Number of samples to trace in free space."""
    return FREE_PER_GAUSSIAN * coarse_count(budget)


def known_counts(gaussians: int) -> tuple[int, int]:
    """Numbers of points of both rounds of known light, where shapes call for so many `gaussians`."""
    last = min(KNOWN_PER_GAUSSIAN * gaussians, KNOWN_MOST)
    return last // 2, last


def connected_layers(layers: int) -> int:
    """Layers of paths that are traced of so many where paths are connected to lit places."""
    return max(round(CONNECTED_PATHS * layers), 1)


def file_bytes(budget: int, groups: int = 0, bumpy: bool = False) -> int:
    """Bytes that a file with `budget` Gaussians and so many light groups hardly exceeds, of a `bumpy` scene or not."""
    coarse = coarse_count(budget)
    return codec.file_bytes(budget - coarse, FINE_DEGREE, coarse, COARSE_DEGREE, FINE_BASIS, groups, bumpy)
