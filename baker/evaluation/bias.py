"""How far references whose paths end in known light are from whole paths, measured at a few of their pixels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import Sampling

from .pixels import at_pixels

POINTS = 1 << 12  # pixels of all references
SAMPLES = 256  # whole paths at each of them
PATHS = POINTS * SAMPLES
SEED = 3000  # from a bake's seed to that of these paths

# Least share of a view's pixels to which whole paths must bring light: the mean of what few of them find is not known.
MET = 0.5

LARGE = 0.02  # a bias that a user should know
SURE = 3  # standard errors that it is from none


@dataclass(frozen=True)
class Bias:
    """Relative `bias` of the brightness of B, as a mean over views, and its `standard_error`."""

    bias: float
    standard_error: float

    @property
    def large(self) -> bool:
        """Whether the references, and with them the samples of a bake, are visibly too bright or too dark."""
        return abs(self.bias) > LARGE + SURE * self.standard_error


def measure(tracer: CachedTracer, references: Mapping[str, Reference], seed: int) -> Bias | None:
    """Compare references with whole paths at the same POINTS pixels for a `seed`.

    None if none of them sees light, or light that few whole paths find alone.
    """
    columns = at_pixels(references, POINTS, seed, "position", "shading_normal", "geometric_normal")
    if not columns:
        return None
    position, normal, geometric, gathered = (column.reshape(-1, 3) for column in columns)
    sampling = Sampling(SAMPLES)
    whole = tracer.at_points(position, normal, sampling, seed + SEED, geometric_normal=geometric).mean
    pairs = np.stack([gathered, whole], axis=1).mean(axis=2, dtype=np.float64).reshape(len(columns[0]), -1, 2)
    lit = pairs[(pairs[..., 1] > 0).mean(axis=1) >= MET]
    if not len(lit):
        return None
    of_view = (lit[..., 0] - lit[..., 1]) / lit[..., 1].mean(axis=1, keepdims=True)
    error = np.sqrt((of_view.var(axis=1) / of_view.shape[1]).sum()) / len(of_view)
    return Bias(float(of_view.mean()), float(error))
