"""What every operator's fit gives to the bake."""

from collections.abc import Callable
from typing import NamedTuple

from gsgi.runtime.gaussians import Gaussians

from .watch import Look, Watch


class Fit(NamedTuple):
    """Both levels (`coarse` None with `over`), the history of looks, empty where the cache held the fit, and the
    seconds that it took without the tracing before. `covered`: the share of surface samples at which the fine level
    alone gives the light; None with `over`."""

    gaussians: Gaussians
    coarse: Gaussians | None
    looks: tuple[Look, ...]
    seconds: float
    covered: float | None = None


# Makes the watch of a fit from its `advance` and coarse level.
Watching = Callable[[Callable[..., None], Gaussians | None], Watch]
