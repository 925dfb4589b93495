"""The search for the fewest Gaussians whose loss in held-out views meets a target.

The answer is the fewest to within a factor of 1.4. Budgets are tried in rising order. Each is a fit of its own that
knows nothing of the target, so a tighter target continues where a looser one stops and never needs fewer Gaussians.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from .fitting.task import HistoryEntry

FEWEST = 256  # Gaussians of the first attempt
STEP = 2  # between budgets
GAIN = 0.02  # share of the loss; two budgets in a row that gain less end the search


@dataclass(frozen=True)
class Attempt:
    """One fit of the search: the `data` of its .gsgi file with `count` Gaussians, at most `budget`.

    `loss` and `psnr` (of B, dB) are means over the held-out views, None where no held-out view shows a B. `seconds` is
    the time of the fit including its start and the evaluations while it ran; next to none where the cache held it.
    `history` is empty where the cache held the fit. `coverage` is that of `FitResult`.
    """

    budget: int
    data: bytes
    count: int
    loss: float | None
    psnr: float | None
    seconds: float
    history: tuple[HistoryEntry, ...] = ()
    coverage: float | None = None


def search(target: float, most: int, attempt: Callable[[int], Attempt]) -> tuple[Attempt, list[Attempt]]:
    """The attempt with the fewest Gaussians whose loss is at most `target`, else the one with the least loss; and all
    attempts in order. `attempt(budget)` fits; no budget is above `most`."""
    attempts: list[Attempt] = []
    for budget in budgets(most):
        attempts.append(attempt(budget))
        if attempts[-1].loss <= target:
            between = round((attempts[-1].budget * attempts[-2].budget) ** 0.5) if len(attempts) > 1 else budget
            if len(attempts) > 1 and between not in (attempts[-1].budget, attempts[-2].budget):
                attempts.append(attempt(between))
            break
        if _stalled([attempt.loss for attempt in attempts]):
            break
    met = [attempt for attempt in attempts if attempt.loss <= target]
    chosen = min(met, key=lambda a: a.count) if met else min(attempts, key=lambda a: a.loss)
    return chosen, attempts


def budgets(most: int) -> Iterator[int]:
    """FEWEST, then STEP times as many each, and finally `most`."""
    budget = FEWEST
    while budget < most:
        yield budget
        budget *= STEP
    yield most


def _stalled(losses: list[float]) -> bool:
    """Whether the last two losses gained next to nothing on the best before them."""
    return len(losses) > 2 and min(losses[-2:]) > (1 - GAIN) * min(losses[:-2])
