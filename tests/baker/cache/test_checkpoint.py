"""A fit that is interrupted goes on where it was, to the same bits."""

from itertools import pairwise

import numpy as np
import pytest
import scenes

from gsgi.baker.cache import checkpoint as module
from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.store import Cache, entries, task_key
from gsgi.baker.over.fit import Schedule, TargetView, fit
from gsgi.runtime.gaussians import Gaussians, OverBlend

KEY = task_key("checkpoint", number=1)
FIELDS = ("position", "rotation", "scale", "opacity", "sh")
ITERATIONS, COUNT, BUDGET = 40, 20, 60


class Killed(BaseException):
    """Ends a fit as a signal would."""


def problem(degree: int = 0) -> tuple:
    """start, views, blend, tone scale and course of a small fit."""
    rng = np.random.default_rng(0)
    position = rng.uniform(-0.5, 0.5, (COUNT, 3)).astype(np.float32) - np.float32([0, 0, 1])
    rotation = np.tile(np.float32([0, 0, 0, 1]), (COUNT, 1))
    sh = rng.random((COUNT, (degree + 1) ** 2, 3), np.float32)
    start = Gaussians(position, rotation, np.full((COUNT, 3), 0.1, np.float32), np.full(COUNT, 0.5, np.float32), sh)
    views = [
        TargetView(scenes.inside_camera(), rng.random((24, 24, 3), np.float32), np.ones((24, 24), bool))
        for _ in range(3)
    ]
    return start, views, OverBlend(near=0.01), 0.5, Schedule(BUDGET, ITERATIONS, seed=5)


@pytest.fixture
def always_due(monkeypatch):
    """A state is kept after each iteration."""
    monkeypatch.setattr(module, "INTERVAL", 0.0)
    monkeypatch.setattr(module, "SHARE", 1e9)


@pytest.fixture(scope="module")
def undisturbed() -> tuple[Gaussians, list[tuple]]:
    """The result, and what `watch` was told: iteration, loss, number of Gaussians."""
    told = []
    return fit(*problem(), lambda *args: told.append(heard(*args))), told


def heard(iteration: int, loss: float, gaussians) -> tuple:
    return iteration, loss, len(gaussians())


def run_until(stop: int, folder, degree: int = 0, kind: type = Checkpoint) -> list[tuple]:
    """Killed in iteration `stop`, before its state was kept; what `watch` was told."""
    told = []

    def watch(*args):
        told.append(heard(*args))
        if args[0] == stop:
            raise Killed

    with pytest.raises(Killed):
        fit(*problem(degree), watch, kind(Cache(folder), KEY))
    return told


def assert_same(a: Gaussians, b: Gaussians):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def changes(told: list[tuple]) -> list[int]:
    """Iterations that were the first with another number of Gaussians."""
    return [b[0] for a, b in pairwise(told) if a[2] != b[2]]


def test_the_number_of_gaussians_changes_while_it_is_interrupted(undisturbed):
    """Else the tests below would show less than they say."""
    assert len(changes(undisturbed[1])) >= 3
    assert COUNT < len(undisturbed[0]) <= BUDGET


@pytest.mark.parametrize("stop", range(1, ITERATIONS + 1))
def test_an_interrupted_fit_ends_in_the_same_bits(tmp_path, always_due, undisturbed, stop):
    expected, told = undisturbed
    assert run_until(stop, tmp_path) == told[:stop]
    assert len(entries(tmp_path)) == (stop > 1)  # the latest state only
    again = []
    result = fit(*problem(), lambda *args: again.append(heard(*args)), Checkpoint(Cache(tmp_path), KEY))
    assert again == told[stop - 1 :]  # nothing was done twice, but for what was not kept
    assert_same(result, expected)


def test_a_fit_that_is_interrupted_all_the_time_ends_in_the_same_bits(tmp_path, always_due, undisturbed):
    for stop in range(2, ITERATIONS + 1):
        assert len(run_until(stop, tmp_path)) == 2  # the one before was not kept
    assert_same(fit(*problem(), checkpoint=Checkpoint(Cache(tmp_path), KEY)), undisturbed[0])


def test_colours_that_depend_on_the_direction_are_kept(tmp_path, always_due):
    run_until(ITERATIONS // 2, tmp_path, degree=2)
    assert_same(fit(*problem(2), checkpoint=Checkpoint(Cache(tmp_path), KEY)), fit(*problem(2)))


def test_states_seldom_kept_lead_to_the_same_bits(tmp_path, monkeypatch, undisturbed):
    """A state as old as the number of Gaussians was another."""
    saves = []

    class Seldom(Checkpoint):
        def due(self) -> bool:
            saves.append(None)
            return len(saves) == 2

    stop = changes(undisturbed[1])[-1] + 1
    run_until(stop, tmp_path, kind=Seldom)
    assert int(Cache(tmp_path).get(KEY)["iteration"]) == 2
    assert_same(fit(*problem(), checkpoint=Checkpoint(Cache(tmp_path), KEY)), undisturbed[0])


def test_a_finished_state_is_the_result(tmp_path, always_due, undisturbed):
    fit(*problem(), checkpoint=Checkpoint(Cache(tmp_path), KEY))
    again = []
    result = fit(*problem(), lambda *args: again.append(args), Checkpoint(Cache(tmp_path), KEY))
    assert not again
    assert_same(result, undisturbed[0])


def test_a_state_that_is_removed_is_not_found(tmp_path):
    checkpoint = Checkpoint(Cache(tmp_path), KEY)
    assert checkpoint.load() is None
    checkpoint.save({"a": np.arange(3)})
    np.testing.assert_array_equal(Checkpoint(Cache(tmp_path), KEY).load()["a"], np.arange(3))
    checkpoint.remove()
    assert checkpoint.load() is None


def test_saving_takes_little_of_the_time(tmp_path, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: clock[0])

    class Slow(Cache):
        def put(self, key, arrays):
            clock[0] += 1.0

    checkpoint = Checkpoint(Slow(tmp_path), KEY)
    assert not checkpoint.due()
    clock[0] = module.INTERVAL
    assert checkpoint.due()
    checkpoint.save({})
    clock[0] += 0.99 / module.SHARE
    assert not checkpoint.due()
    clock[0] += 0.02 / module.SHARE
    assert checkpoint.due()
