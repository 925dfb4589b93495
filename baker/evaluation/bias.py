"""How far references whose paths end in known light are from whole paths, measured at a few of their pixels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import Sampling

POINTS = 1 << 12  # pixels of all references
SAMPLES = 256  # whole paths at each of them
PATHS = POINTS * SAMPLES
SEED = 3000  # from a bake's seed to that of these paths

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
    """Compare references with whole paths at the same POINTS pixels for a `seed`; None if none of them sees light."""
    seen = [reference for reference in references.values() if reference.indirect.any()]
    if not seen:
        return None
    rng = np.random.default_rng(seed)
    index = [rng.integers(np.count_nonzero(r.valid), size=-(-POINTS // len(seen))) for r in seen]
    layers = [(r.surface.position, r.surface.shading_normal, r.surface.geometric_normal, r.indirect) for r in seen]
    position, normal, geometric, gathered = (
        np.concatenate([image[r.valid][at] for r, image, at in zip(seen, images, index, strict=True)])
        for images in zip(*layers, strict=True)
    )
    sampling = Sampling(SAMPLES)
    whole = tracer.at_points(position, normal, sampling, seed + SEED, geometric_normal=geometric).mean
    pairs = np.stack([gathered, whole], axis=1).mean(axis=2, dtype=np.float64).reshape(len(seen), -1, 2)
    lit = pairs[pairs[..., 1].any(axis=1)]
    if not len(lit):
        return None
    of_view = (lit[..., 0] - lit[..., 1]) / lit[..., 1].mean(axis=1, keepdims=True)
    error = np.sqrt((of_view.var(axis=1) / of_view.shape[1]).sum()) / len(of_view)
    return Bias(float(of_view.mean()), float(error))
