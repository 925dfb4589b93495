"""Search for the fewest Gaussians whose loss in held-out views meets a target.

The answer is the minimum to within a factor of 1.4. Budgets are tried in ascending order. Each attempt is a separate
fit that does not depend on the target, so a tighter target continues where a looser one stops and never gets fewer
Gaussians.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from .fitting.task import HistoryEntry

FEWEST = 256  # budget of the first attempt
STEP = 2  # ratio of successive budgets
GAIN = 0.02  # relative decrease of the loss; two budgets in a row that gain less end the search


@dataclass(frozen=True)
class Attempt:
    """One fit of the search: the `data` of its .gsgi file, which holds `count` Gaussians (at most `budget`).

    `loss` and `psnr` (of B, dB) are means over the held-out views; None if there is no reference that shows B.
    `seconds` is the time of the fit, including its start and the evaluations while it ran; it is almost 0 if the cache
    held the fit, and `history` is then empty. `coverage` is that of `FitResult`.
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
    """Return the attempt with the fewest Gaussians whose loss is at most `target`, and all attempts in order.

    If no attempt meets the target, the first is the one with the least loss. `attempt(budget)` runs a fit; no budget
    exceeds `most`.
    """
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
    """Yield FEWEST, then each time STEP times as many, and finally `most`."""
    budget = FEWEST
    while budget < most:
        yield budget
        budget *= STEP
    yield most


def _stalled(losses: list[float]) -> bool:
    """Whether the last two losses hardly improved on the best one before them."""
    return len(losses) > 2 and min(losses[-2:]) > (1 - GAIN) * min(losses[:-2])
