"""Turns: which samples a step of a fit looks at."""

import numpy as np
import pytest

from gsgi.baker.surface import coarse, fit
from gsgi.baker.surface.optimiser import LIST_STEPS
from gsgi.baker.surface.turns import Turns, every, mean_part

PARTS = {0.0: 4, 0.5: 2, 0.75: 1}


def test_each_sample_has_its_turn_and_in_the_end_all_count():
    turns = Turns(PARTS, 80, 5, lambda part: part)
    samples = np.arange(103)
    for first, last in ((0, 20), (20, 40), (40, 50), (50, 60)):
        seen = [samples[turns.part(step)] for step in range(first, last, 5)]
        np.testing.assert_array_equal(np.sort(np.concatenate(seen)), samples)
    for step in range(80):
        assert turns.part(step) == turns.part(step // 5 * 5)  # the same throughout a turn
    for step in (60, 79, 80):
        np.testing.assert_array_equal(samples[turns.part(step)], samples)
    assert Turns(PARTS, 0, 5, lambda part: part).part(0).step == 1  # a fit without steps has come to its end


def test_a_turn_that_comes_again_has_the_same_optimiser_until_parts_grow():
    made = []
    turns = Turns(PARTS, 80, 5, lambda part: made.append(part) or object())
    first = [turns.at(step) for step in range(0, 20, 5)]
    assert [turns.at(step) for step in range(20, 40, 5)] == first
    assert len(set(first)) == 4
    assert len(made) == 1 + 4
    for step in range(40, 81):
        turns.at(step)
    assert len(made) == 1 + 4 + 2
    assert turns.at(80) is turns.whole
    assert turns.at(0) not in first  # those of the start no longer take memory


@pytest.mark.parametrize("parts", [PARTS, fit.PARTS, coarse.PARTS])
def test_the_mean_part_is_that_over_the_steps(parts):
    steps = np.arange(0, 1, 1 / 1200)
    assert mean_part(parts) == pytest.approx(np.mean([1 / every(parts, share) for share in steps]), abs=1e-3)


def test_turns_begin_where_samples_are_listed():
    """A step from one listing to the next knows what an earlier one of the same samples has listed."""
    assert coarse.TURN_STEPS % LIST_STEPS == coarse.TURN_STEPS % coarse.SOLVE_STEPS == 0
    assert coarse.GROWN_AFTER % coarse.TURN_STEPS == 0
    for share in coarse.PARTS:
        assert round(share * coarse.STEPS) % coarse.TURN_STEPS == 0
