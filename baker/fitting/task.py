"""A fit as a task: its result, and how it resumes after an interruption."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.cache.store import Cache, task_key
from gsgi.runtime.gaussians import Gaussians


class HistoryEntry(NamedTuple):
    """The state of a fit after a number of iterations and seconds.

    `gaussians` counts those of both levels; `loss` and `psnr` (dB) are those of B in the held-out views.
    """

    iteration: int
    seconds: float
    gaussians: int
    loss: float
    psnr: float


class FitResult(NamedTuple):
    """The Gaussians of both levels; `coarse` is None with `over`.

    `history` is empty where the cache held the fit. `seconds` is the time of the fit without the tracing before it.
    `coverage` is the share of surface samples at which the fine level alone gives the light, or None with `over`.
    """

    gaussians: Gaussians
    coarse: Gaussians | None
    history: tuple[HistoryEntry, ...]
    seconds: float
    coverage: float | None = None


class Monitor(Protocol):
    """Observer of a fit, called after each iteration.

    The arguments are the number of the iteration, its loss, and a function that returns the resulting Gaussians.
    `history` is what the monitor recorded.
    """

    history: list[HistoryEntry]

    def __call__(self, iteration: int, loss: float, gaussians: Callable[[], Gaussians]) -> None: ...


# Makes the monitor of a fit from the `advance` of its progress stage and the coarse level, which is None with `over`.
MakeMonitor = Callable[[Callable[..., None], Gaussians | None], Monitor]


def run_or_resume(
    cache: Cache, inputs: dict, make_monitor: Callable[[], Monitor], fit: Callable[[Monitor, Checkpoint], Gaussians]
) -> tuple[Gaussians, tuple[HistoryEntry, ...] | None]:
    """The result of the fit that `inputs` describe, and its history, which is None if the cache held the result.

    An interrupted fit resumes from its checkpoint; a finished one is not repeated.
    """
    key = task_key("fit", **inputs)
    if found := cache.get(key):
        return from_arrays(Gaussians, found), None
    monitor, checkpoint = make_monitor(), Checkpoint(cache, task_key("checkpoint", **inputs))
    gaussians = fit(monitor, checkpoint)
    cache.put(key, to_arrays(gaussians))
    checkpoint.remove()
    return gaussians, tuple(monitor.history)
