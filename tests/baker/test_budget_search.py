"""The budget search: the fewest Gaussians that meet a target, whatever the losses that the budgets turn out to have."""

from itertools import pairwise

import numpy as np
import pytest

from gsgi.baker.budget_search import FEWEST, GAIN, STEP, Attempt, budgets, search

MOST = 40 * FEWEST
RUNGS = list(budgets(MOST))
NEVER = 1e-9


class Attempts:
    """Fits whose loss is a function of the budget, and the budgets that were asked for."""

    def __init__(self, loss):
        self.loss, self.asked = loss, []

    def __call__(self, budget: int) -> Attempt:
        self.asked.append(budget)
        return Attempt(budget, bytes(4), budget, self.loss(budget), 0.0, 0.0)


def searched(target: float, loss, most: int = MOST) -> tuple[Attempt, list[int]]:
    """The chosen attempt and the budgets that were tried."""
    attempts = Attempts(loss)
    chosen, made = search(target, most, attempts)
    assert [attempt.budget for attempt in made] == attempts.asked
    assert chosen in made
    assert len(set(attempts.asked)) == len(attempts.asked)  # none is fitted twice
    return chosen, attempts.asked


def falling(budget: int) -> float:
    return budget**-0.5


def noisy_table(seed: int, noise: float) -> dict[int, float]:
    """A loss for each budget that a search may ask for: falling, with noise as large as one likes."""
    between = [round((a * b) ** 0.5) for a, b in pairwise(RUNGS)]
    rng = np.random.default_rng(seed)
    return {budget: falling(budget) * float(np.exp(noise * rng.normal())) for budget in (*RUNGS, *between)}


@pytest.mark.parametrize("most", [1, FEWEST - 1, FEWEST, FEWEST + 1, STEP * FEWEST, 1000, MOST])
def test_budgets_rise_by_steps_and_end_with_the_most(most):
    rungs = list(budgets(most))
    assert rungs == sorted(set(rungs))
    assert rungs[-1] == most
    assert rungs[:-1] == [FEWEST * STEP**k for k in range(len(rungs) - 1)]


@pytest.mark.parametrize("rung", range(1, len(RUNGS)))
def test_it_ends_where_the_target_is_met_or_halfway_there(rung):
    below, above = RUNGS[rung - 1 : rung + 1]
    between = round((below * above) ** 0.5)
    chosen, asked = searched(falling(between), falling)
    assert asked == [*RUNGS[: rung + 1], between]
    assert chosen.budget == between
    chosen, asked = searched(falling(between + 1), falling)
    assert asked == [*RUNGS[: rung + 1], between]
    assert chosen.budget == above


def test_a_target_that_the_first_try_meets_takes_one_try():
    chosen, asked = searched(falling(FEWEST), falling)
    assert asked == [chosen.budget] == [FEWEST]


def test_a_target_that_is_never_met_gets_the_best():
    chosen, asked = searched(NEVER, falling)
    assert asked == RUNGS
    assert chosen.budget == MOST
    worst_last = {MOST: 1.0}
    chosen, asked = searched(NEVER, lambda budget: worst_last.get(budget, falling(budget)))
    assert asked == RUNGS
    assert chosen.budget == RUNGS[-2]


def test_it_stops_where_more_does_not_help():
    assert searched(NEVER, lambda _: 0.5)[1] == RUNGS[:3]
    slow = {budget: 0.5 * (1 - 0.4 * GAIN) ** k for k, budget in enumerate(RUNGS)}
    assert searched(NEVER, slow.__getitem__)[1] == RUNGS[:3]
    steady = {budget: 0.5 * (1 - 0.6 * GAIN) ** k for k, budget in enumerate(RUNGS)}
    assert searched(NEVER, steady.__getitem__)[1] == RUNGS
    knee = {budget: max(falling(budget), falling(RUNGS[2])) for budget in RUNGS}
    assert searched(NEVER, knee.__getitem__)[1] == RUNGS[:5]


def test_one_bad_fit_does_not_end_the_search():
    unlucky = {RUNGS[1]: 1.0, RUNGS[3]: 1.0}
    chosen, asked = searched(falling(RUNGS[4]), lambda budget: unlucky.get(budget, falling(budget)))
    assert asked[:5] == RUNGS[:5]
    assert chosen.loss <= falling(RUNGS[4])


@pytest.mark.parametrize("most", [1, 100, FEWEST, FEWEST + 1, 300, MOST])
def test_no_try_has_more_than_the_most(most):
    chosen, asked = searched(NEVER, falling, most)
    assert max(asked) == asked[-1] == chosen.budget == most
    for target in (0.5, falling(most), NEVER):
        assert max(searched(target, falling, most)[1]) <= most


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5, 3.0])
def test_a_tighter_target_never_takes_fewer_gaussians(noise):
    for seed in range(50):
        loss = noisy_table(seed, noise)
        targets = sorted({*loss.values(), *np.geomspace(1e-4, 10, 30)}, reverse=True)
        found = [searched(target, loss.__getitem__)[0] for target in targets]
        counts = [attempt.count for attempt in found]
        assert counts == sorted(counts), (seed, counts)


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_it_is_the_smallest_try_that_meets_the_target(noise):
    for seed in range(50):
        loss = noisy_table(seed, noise)
        for target in np.geomspace(falling(MOST) / 2, 1, 20):
            chosen, asked = searched(target, loss.__getitem__)
            met = [budget for budget in asked if loss[budget] <= target]
            assert chosen.budget == (min(met) if met else min(asked, key=loss.__getitem__))
