"""The length of a fit, and the growth of its number of Gaussians."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """At most `budget` Gaussians after `iterations` steps; `seed` determines all random choices."""

    budget: int
    iterations: int
    seed: int = 0


def count_after(start: int, budget: int, done: float) -> int:
    """The largest number of Gaussians once a share `done` of the growth is over.

    It grows fast first and slowly at the end, on a fixed curve up to the budget (Mallick et al. 2024, "Taming 3DGS").
    """
    return round(start + (budget - start) * (1 - (1 - done) ** 2))
