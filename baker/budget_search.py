"""The dial between accuracy and cost: the fewest Gaussians whose loss in views that were not fitted meets a target.

The fewest to within a factor of 1.4. Budgets are tried in rising order, each a fit of its own that knows nothing of the
target. A tighter target goes on where a looser one stops: it never ends with fewer Gaussians.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

FEWEST = 256  # Gaussians of the first try
STEP = 2  # between budgets
GAIN = 0.02  # share of the loss; two budgets in a row that gain less end the search


@dataclass(frozen=True)
class Fitted:
    """One try: the `data` of its file with `count` Gaussians, of `budget` that it might have had; its loss and the PSNR
    of B (dB) in the views that were not fitted, None where none shows a B; and the seconds that it took, its start and
    looks at those views included, next to none where the cache held it. `looks` is its history, see `watch.Look`, empty
    where the cache held it; `covered` see `fitting.Fit`."""

    budget: int
    data: bytes
    count: int
    loss: float | None
    psnr: float | None
    seconds: float
    looks: tuple = ()
    covered: float | None = None


def turn(target: float, most: int, attempt: Callable[[int], Fitted]) -> tuple[Fitted, list[Fitted]]:
    """The try with the fewest Gaussians whose loss is at most `target`, else the one with the least loss; and all."""
    tried: list[Fitted] = []
    for budget in budgets(most):
        tried.append(attempt(budget))
        if tried[-1].loss <= target:
            between = round((tried[-1].budget * tried[-2].budget) ** 0.5) if len(tried) > 1 else budget
            if len(tried) > 1 and between not in (tried[-1].budget, tried[-2].budget):
                tried.append(attempt(between))
            break
        if _stalled([fitted.loss for fitted in tried]):
            break
    met = [fitted for fitted in tried if fitted.loss <= target]
    chosen = min(met, key=lambda f: f.count) if met else min(tried, key=lambda f: f.loss)
    return chosen, tried


def budgets(most: int) -> Iterator[int]:
    """FEWEST, then STEP times as many each, and `most` at last."""
    budget = FEWEST
    while budget < most:
        yield budget
        budget *= STEP
    yield most


def _stalled(losses: list[float]) -> bool:
    """Whether the last two losses gained next to nothing on the best before."""
    return len(losses) > 2 and min(losses[-2:]) > (1 - GAIN) * min(losses[:-2])
