"""What every operator's fit gives to the bake."""

from collections.abc import Callable
from typing import NamedTuple

from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.cache.store import Cache, task_key
from gsgi.runtime.gaussians import Gaussians

from .monitor import Look, Watch


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


def kept(
    cache: Cache, inputs: dict, watch: Callable[[], Watch], fit: Callable[[Watch, Checkpoint], Gaussians]
) -> tuple[Gaussians, tuple[Look, ...] | None]:
    """The result of the fit that `inputs` describe, and its looks: None where the cache held it.

    Interrupted, a fit goes on from its checkpoint; done, it is not done again.
    """
    key = task_key("fit", **inputs)
    if found := cache.get(key):
        return from_arrays(Gaussians, found), None
    seen, checkpoint = watch(), Checkpoint(cache, task_key("checkpoint", **inputs))
    gaussians = fit(seen, checkpoint)
    cache.put(key, to_arrays(gaussians))
    checkpoint.remove()
    return gaussians, tuple(seen.looks)
