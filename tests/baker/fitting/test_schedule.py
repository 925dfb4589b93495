"""How the number of Gaussians grows during a fit."""

import numpy as np
import pytest

from gsgi.baker.fitting.schedule import count_after


@pytest.mark.parametrize(("start", "budget"), [(10, 1000), (0, 7), (500, 500), (1, 2), (100, 10)])
def test_the_count_goes_from_the_start_to_the_budget_and_never_back(start, budget):
    counts = [count_after(start, budget, done) for done in np.linspace(0, 1, 101)]
    assert counts[0] == start
    assert counts[-1] == budget
    assert all(isinstance(count, int) for count in counts)
    assert np.all(np.diff(counts) * np.sign(budget - start) >= 0)


def test_the_count_grows_fast_first():
    grown = np.diff([count_after(0, 10_000, done) for done in np.linspace(0, 1, 11)])
    assert np.all(np.diff(grown) < 0)
