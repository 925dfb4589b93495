"""Progress of a running fit: loss, held-out PSNR, number of Gaussians, and pictures."""

import time
from collections.abc import Callable

from gsgi.baker.fitting.task import HistoryEntry
from gsgi.runtime.gaussians import Bake, Gaussians

from .held_out import HeldOutLoss
from .preview import Preview

ENTRIES = 10  # in the history, approximately; evenly spaced over the iterations
MEMORY = 0.98  # decay of the running mean of the loss, per iteration


def entries(iterations: int) -> int:
    """Number of entries in the history of a fit."""
    return iterations // interval(iterations)


def interval(iterations: int) -> int:
    """Iterations from one entry to the next."""
    return max(iterations // ENTRIES, 1)


class FitMonitor:
    """A `fitting.task.Monitor` that reports each iteration of a fit to the progress.

    The seconds in its `history` exclude the time of evaluations and previews.
    """

    def __init__(
        self,
        advance: Callable[..., None],
        held_out: HeldOutLoss | None,
        bake_of: Callable[[Gaussians], Bake],
        iterations: int,
        preview: Preview | None,
    ):
        """`bake_of` makes a bake from the Gaussians of an iteration."""
        self.history: list[HistoryEntry] = []
        self._advance, self._held_out, self._bake_of, self._preview = advance, held_out, bake_of, preview
        self._interval = interval(iterations)
        self._iteration, self._loss, self._note = 0, None, ""
        self._start = time.perf_counter()

    def __call__(self, iteration: int, loss: float, gaussians: Callable[[], Gaussians]) -> None:
        self._loss = loss if self._loss is None else MEMORY * self._loss + (1 - MEMORY) * loss
        if iteration % self._interval == 0:
            self._record(iteration, gaussians())
        self._advance(iteration - self._iteration, f"loss {self._loss:.4f}{self._note}")
        self._iteration = iteration

    def _record(self, iteration: int, gaussians: Gaussians) -> None:
        before = time.perf_counter()
        baked = self._bake_of(gaussians)
        count = len(baked.gaussians) + len(baked.coarse or ())
        self._note = f", {count} Gaussians"
        if self._held_out:
            loss, psnr = self._held_out.of(baked)
            self.history.append(HistoryEntry(iteration, before - self._start, count, loss, psnr))
            self._note += f", held-out {psnr:.1f} dB"
        if self._preview:
            self._preview.draw(iteration, baked)
        self._start += time.perf_counter() - before
