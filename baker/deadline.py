"""The best bake with `surface` that ends in a given time on this machine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gsgi.runtime.errors import UsageError

from .cache.records import from_arrays, to_arrays
from .cache.store import task_key
from .estimate import Rates
from .plan import Plan
from .progress import Progress
from .settings import BUDGET_MAX, Settings

# What a bake may cost, from the least to the most: factor on the budget of medium quality, error, steps of the fit.
# First the fit takes all of its steps, then the Gaussians become as many as with medium quality, then the noise falls
# from that of a coarse bake, then the Gaussians become as many as with high quality, then the noise falls further.
# Between two of them lie PARTS steps.
LADDER = (1 / 4, 0.2, 80), (1 / 4, 0.2, 300), (1, 0.2, 300), (1, 0.05, 300), (4, 0.05, 300), (4, 0.0125, 300)
PARTS = 8
LONGER = 2  # most steps of the fit, relative to those on the ladder, that fill the time up to the next rung

DECIDED = "quality", "budget", "target_loss", "error", "iterations"  # the settings that a deadline replaces


class Rung(NamedTuple):
    """Settings of a bake."""

    budget: int
    error: float
    iterations: int


@dataclass(frozen=True)
class Deadline:
    """The settings of a bake that was to take `asked` seconds, and the seconds that it was `expected` to take."""

    asked: float
    budget: int
    error: float
    iterations: int
    expected: float

    @property
    def flags(self) -> str:
        """The flags of the same bake without a deadline."""
        return f"--budget {self.budget} --error {self.error} --iterations {self.iterations}"


def check(settings: Settings, seconds: float) -> None:
    """Raise UsageError if a bake with these settings cannot be one of so many `seconds`."""
    if not 0 < seconds < float("inf"):
        raise UsageError(f"seconds: expected a number above 0, got {seconds!r}")
    if settings.operator != "surface":
        raise UsageError(f"seconds: expected the operator surface, got {settings.operator}")
    for field in DECIDED:
        if getattr(settings, field) != getattr(Settings, field):
            raise UsageError(f"seconds: it decides the {field.replace('_', ' ')}: leave out one of the two")


class Clock:
    """Decides the settings of a bake that is to end so many seconds after its progress began."""

    def __init__(self, plan: Plan, seconds: float, evaluate: bool, progress: Progress):
        """`plan` is that of medium quality. Parts of its bake are timed, unless its cache holds a decision.

        An interrupted bake goes on with that decision, however long it has taken. Warns if there is too little time.
        """
        self._plan, self._seconds, self._evaluate, self._progress = plan, seconds, evaluate, progress
        inputs = {
            "scene": plan.tracer.scene_digest,
            "settings": plan.settings,
            "views": plan.cameras,
            "groups": plan.groups,
        }
        self._key = task_key("deadline", ladder=LADDER, seconds=seconds, evaluate=evaluate, **inputs)
        found = plan.tracer.cache.get(self._key)
        self._decided = from_arrays(Deadline, found) if found else None
        if self._decided:
            return
        self._rungs = rungs(plan.settings.budget)
        with progress.stage("estimate"):
            self._rates = Rates.timed(plan)
        if (least := progress.elapsed + self._left(self._rungs[0])) > seconds:
            progress.warn(f"{seconds:g} s are too few: the cheapest bake takes about {least:.0f} s{self._saved()}")

    def decide(self, *done: str) -> Deadline:
        """What fits into the time that is left. Stages that are `done` take none of it."""
        if self._decided:
            self._progress.say(f"{self._seconds:g} s: as decided before, {self._decided.flags}")
            return self._decided
        spent = self._progress.elapsed
        if self._plan.sampler.prepared:
            self._rungs = rungs(self._plan.gaussians(self._plan.settings.budget))
        rung = fitting(self._rungs, lambda rung: self._left(rung, *done), self._seconds - spent)
        decided = Deadline(self._seconds, *rung, spent + self._left(rung, *done))
        early = ": no setting takes longer" if rung == longest(self._rungs[-1]) else ""
        self._progress.say(f"{self._seconds:g} s: {decided.flags}, about {decided.expected:.0f} s in all{early}")
        return decided

    def keep(self, decided: Deadline) -> None:
        """Keep a decision in the cache for the bake that goes on after an interruption."""
        self._plan.tracer.cache.put(self._key, to_arrays(decided))

    def _with(self, rung: Rung) -> Plan:
        return replace(self._plan, settings=replace(self._plan.settings, **rung._asdict()))

    def _left(self, rung: Rung, *done: str) -> float:
        """Seconds of the stages that are not `done`."""
        stages = self._rates.seconds(self._with(rung), self._evaluate)
        return sum(seconds for stage, seconds in stages.items() if stage not in done)

    def _saved(self) -> str:
        """What would save time."""
        if not self._evaluate:
            return "; fewer views would save some"
        cheapest = self._with(self._rungs[0])
        whole, without = (sum(self._rates.seconds(cheapest, evaluate).values()) for evaluate in (True, False))
        return f", about {whole - without:.0f} s of them for the evaluation (--no-evaluate)"


def in_time(plan: Plan, seconds: float, progress: Progress) -> Plan:
    """A plan of medium quality with the settings for a bake of so many seconds, its evaluation among them."""
    decided = Clock(plan, seconds, True, progress).decide()
    return plan.spending(decided.budget, decided.error, decided.iterations)


def rungs(medium: int) -> list[Rung]:
    """All rungs of the ladder, where a bake of medium quality has so many Gaussians; error has three digits."""
    columns = np.log(LADDER)
    at = np.linspace(0, len(LADDER) - 1, PARTS * (len(LADDER) - 1) + 1)
    between = np.exp([np.interp(at, range(len(LADDER)), column) for column in columns.T]).T
    return [
        Rung(min(max(round(factor * medium), 1), BUDGET_MAX), float(f"{error:.3g}"), round(steps))
        for factor, error, steps in between
    ]


def longest(rung: Rung) -> Rung:
    """A rung with as many steps of the fit as fill the time up to the next one."""
    return rung._replace(iterations=LONGER * rung.iterations)


def fitting(rungs: Sequence[Rung], takes: Callable[[Rung], float], left: float) -> Rung:
    """The last of `rungs` that `takes` at most the seconds that are `left`, else the first.

    Further steps of the fit fill the rest of the time.
    """
    chosen = next((rung for rung in reversed(rungs) if takes(rung) <= left), rungs[0])
    least, most = takes(chosen), takes(longest(chosen))
    share = min(max((left - least) / max(most - least, 1e-9), 0.0), 1.0)
    return chosen._replace(iterations=chosen.iterations + int(share * (LONGER - 1) * chosen.iterations))
