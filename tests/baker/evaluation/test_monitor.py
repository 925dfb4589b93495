"""What a fit shows: looks at the held-out views, evenly, whose time does not count, and the loss on its way."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from gsgi.baker.evaluation.monitor import ENTRIES, MEMORY, FitMonitor

SLOW = 0.05  # s that a look takes


def slow(baked) -> tuple[float, float]:
    time.sleep(SLOW)
    count = len(baked.gaussians) + len(baked.coarse)
    return 1 / count, 10.0 + count


def monitored(iterations: int, losses, held_out=slow, preview=None, first: int = 1):
    """The monitor after a fit whose Gaussians become more and more, and all that it told the progress."""
    told = []
    lights = held_out and SimpleNamespace(of=held_out)
    baked = lambda gaussians: SimpleNamespace(gaussians=gaussians[2:], coarse=gaussians[:2])  # noqa: E731
    monitor = FitMonitor(lambda amount, note: told.append((amount, note)), lights, baked, iterations, preview)
    for iteration, loss in zip(range(first, iterations + 1), losses, strict=False):
        monitor(iteration, loss, lambda count=7 + iteration: [None] * count)
    return monitor, told


@pytest.mark.parametrize("iterations", [1, 3, ENTRIES, 4 * ENTRIES, 1000])
def test_looks_come_evenly_and_the_last_at_the_end(iterations):
    monitor, _ = monitored(iterations, np.ones(iterations), lambda baked: (0.5, 20.0))
    assert [entry.iteration for entry in monitor.history][-1] == iterations
    steps = np.diff([0, *(entry.iteration for entry in monitor.history)])
    assert set(steps) == {max(iterations // ENTRIES, 1)}


def test_a_look_is_at_the_gaussians_of_that_iteration():
    monitor, told = monitored(4, [0.5] * 4)
    for entry in monitor.history:
        assert entry.gaussians == 7 + entry.iteration
        assert (entry.loss, entry.psnr) == (1 / entry.gaussians, 10 + entry.gaussians)
        assert f"held-out {entry.psnr:.1f} dB" in told[entry.iteration - 1][1]
    assert told[2][1].startswith("loss 0.5000, 10 Gaussians")


def test_the_seconds_of_looking_do_not_count():
    monitor, _ = monitored(8, np.ones(8), preview=SimpleNamespace(draw=lambda *_: time.sleep(SLOW)))
    seconds = [entry.seconds for entry in monitor.history]
    assert len(seconds) == 8
    assert seconds == sorted(seconds)
    assert 0 <= seconds[-1] < SLOW  # of 16 * SLOW in all


def test_the_preview_draws_what_is_looked_at():
    drawn = []
    draw = lambda iteration, baked: drawn.append((iteration, 2 + len(baked.gaussians)))  # noqa: E731
    monitor, _ = monitored(2 * ENTRIES, np.ones(2 * ENTRIES), lambda *_: (0.5, 20.0), SimpleNamespace(draw=draw))
    assert drawn == [(entry.iteration, entry.gaussians) for entry in monitor.history]


def test_gaussians_that_nobody_looks_at_are_not_asked_for():
    """To make them takes time."""
    asked = []
    baked = lambda gaussians: SimpleNamespace(gaussians=gaussians[2:], coarse=gaussians[:2])  # noqa: E731
    monitor = FitMonitor(lambda *_: None, SimpleNamespace(of=lambda baked: (0.5, 20.0)), baked, 4 * ENTRIES, None)
    for iteration in range(1, 9):
        monitor(iteration, 1.0, lambda iteration=iteration: asked.append(iteration) or [None])
    assert asked == [4, 8]


def test_without_held_out_views_there_is_nothing_to_look_at():
    monitor, told = monitored(3, np.ones(3), None)
    assert monitor.history == []
    assert [amount for amount, _ in told] == [1, 1, 1]
    assert "held-out" not in told[-1][1]


def test_what_a_checkpoint_had_done_counts_as_done():
    _, told = monitored(10, np.ones(10), None, first=8)
    assert [amount for amount, _ in told] == [8, 1, 1]


def test_the_loss_is_a_running_mean():
    """One view is brighter than the next: the mean moves by 1 - MEMORY of the difference."""
    _, told = monitored(2, [0.1, 0.9], None)
    shown = [float(note.split(",")[0].removeprefix("loss ")) for _, note in told]
    assert shown == [0.1, pytest.approx(MEMORY * 0.1 + (1 - MEMORY) * 0.9, abs=1e-4)]
