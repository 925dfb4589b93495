"""How far a fit goes, and how its number of Gaussians grows on the way."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """At most `budget` Gaussians after `iterations` steps; `seed` of all random choices."""

    budget: int
    iterations: int
    seed: int = 0


def count_after(start: int, budget: int, done: float) -> int:
    """How many Gaussians there may be once a share `done` of the growth is over: fast first, slowly at the end.

    A fixed curve up to the budget (Mallick et al. 2024, "Taming 3DGS").
    """
    return round(start + (budget - start) * (1 - (1 - done) ** 2))
