"""A fit that is interrupted goes on where it was, to the same bits."""

import numpy as np
import pytest
import scenes
import torch

from gsgi.baker import checkpoint as module
from gsgi.baker.cache import Cache, entries, task_key
from gsgi.baker.checkpoint import Checkpoint
from gsgi.baker.fit import View, fit
from gsgi.runtime.gaussians import Blend, Gaussians

KEY = task_key("checkpoint", number=1)
FIELDS = ("position", "rotation", "scale", "opacity", "sh")


class Killed(BaseException):
    """Ends a fit as a signal would."""


def problem() -> tuple:
    """start, views, blend, tone scale, iterations and seed of a small fit."""
    rng = np.random.default_rng(0)
    position = rng.uniform(-0.5, 0.5, (20, 3)).astype(np.float32) - np.float32([0, 0, 1])
    rotation = np.tile(np.float32([0, 0, 0, 1]), (20, 1))
    start = Gaussians(
        position,
        rotation,
        np.full((20, 3), 0.1, np.float32),
        np.full(20, 0.5, np.float32),
        rng.random((20, 1, 3), np.float32),
    )
    views = [
        View(scenes.inside_camera(), rng.random((24, 24, 3), np.float32), np.ones((24, 24), bool)) for _ in range(3)
    ]
    return start, views, Blend(near=0.01), 0.5, 30, 0


@pytest.fixture(scope="module")
def undisturbed() -> Gaussians:
    return fit(*problem())


@pytest.mark.parametrize("stop", [1, 13, 29])
def test_an_interrupted_fit_ends_in_the_same_bits(tmp_path, monkeypatch, undisturbed, stop):
    monkeypatch.setattr(module, "INTERVAL", 0.0)
    monkeypatch.setattr(module, "SHARE", 1e9)
    done = []

    def advance(amount, note=""):
        done.append(amount)
        if len(done) == stop + 1:
            raise Killed

    with pytest.raises(Killed):
        fit(*problem(), advance, Checkpoint(Cache(tmp_path), KEY))
    assert len(entries(tmp_path)) == 1  # the latest state only
    steps = []
    again = fit(*problem(), lambda amount, note="": steps.append(amount), Checkpoint(Cache(tmp_path), KEY))
    assert steps == [stop] + [1] * (30 - stop)  # nothing was done twice
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(again, name), getattr(undisturbed, name))


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


def test_a_state_restores_everything_a_step_depends_on():
    from gsgi.baker.adam import Adam

    def steps(p, adam, count):
        for _ in range(count):
            ((p - 0.3) ** 4).sum().backward()
            adam.step()

    p = torch.linspace(-1, 1, 7).requires_grad_()
    adam = Adam({"p": p}, {"p": 0.03})
    steps(p, adam, 5)
    state = adam.state()
    steps(p, adam, 5)
    q = torch.zeros(7).requires_grad_()
    other = Adam({"p": q}, {"p": 0.03})
    other.restore(state)
    steps(q, other, 5)
    assert torch.equal(p, q)
