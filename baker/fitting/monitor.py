"""What a fit shows while it runs: loss, held-out PSNR, number of Gaussians, and pictures."""

import time
from collections.abc import Callable
from typing import NamedTuple

from gsgi.baker.evaluation.held_out import HeldOutLoss
from gsgi.runtime.gaussians import Bake, Gaussians

from .preview import Preview

LOOKS = 25  # at the held-out views, evenly over the iterations
MEMORY = 0.98  # of the running mean of the loss, per iteration


class Look(NamedTuple):
    """After so many iterations and seconds of fitting: Gaussians of both levels, loss and PSNR (dB) of held-out B."""

    iteration: int
    seconds: float
    gaussians: int
    loss: float
    psnr: float


class Watch:
    """Called after each iteration of a fit. `looks` is its history; the seconds of looking do not count.

    `baked` makes a bake of the Gaussians of an iteration.
    """

    def __init__(
        self,
        advance: Callable[..., None],
        held_out: HeldOutLoss | None,
        baked: Callable[[Gaussians], Bake],
        iterations: int,
        preview: Preview | None,
    ):
        self.looks: list[Look] = []
        self._advance, self._held_out, self._baked, self._preview = advance, held_out, baked, preview
        self._interval = max(iterations // LOOKS, 1)
        self._iteration, self._loss, self._note = 0, None, ""
        self._start = time.perf_counter()

    def __call__(self, iteration: int, loss: float, gaussians: Callable[[], Gaussians]) -> None:
        self._loss = loss if self._loss is None else MEMORY * self._loss + (1 - MEMORY) * loss
        if iteration % self._interval == 0:
            self._look(iteration, gaussians())
        self._advance(iteration - self._iteration, f"loss {self._loss:.4f}{self._note}")
        self._iteration = iteration

    def _look(self, iteration: int, gaussians: Gaussians) -> None:
        before = time.perf_counter()
        baked = self._baked(gaussians)
        count = len(baked.gaussians) + len(baked.coarse or ())
        self._note = f", {count} Gaussians"
        if self._held_out:
            loss, psnr = self._held_out.of(baked)
            self.looks.append(Look(iteration, before - self._start, count, loss, psnr))
            self._note += f", held-out {psnr:.1f} dB"
        if self._preview:
            self._preview.draw(iteration, baked)
        self._start += time.perf_counter() - before
