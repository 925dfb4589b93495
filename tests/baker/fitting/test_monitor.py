"""What a fit shows: looks at the held-out views, evenly, whose time does not count, and the loss on its way."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from gsgi.baker.fitting.monitor import LOOKS, MEMORY, Watch

SLOW = 0.05  # s that a look takes


def slow(baked) -> tuple[float, float]:
    time.sleep(SLOW)
    count = len(baked.gaussians) + len(baked.coarse)
    return 1 / count, 10.0 + count


def watched(iterations: int, losses, held_out=slow, preview=None, first: int = 1):
    """The watch after a fit whose Gaussians become more and more, and all that it told the progress."""
    told = []
    lights = held_out and SimpleNamespace(of=held_out)
    baked = lambda gaussians: SimpleNamespace(gaussians=gaussians[2:], coarse=gaussians[:2])  # noqa: E731
    watch = Watch(lambda amount, note: told.append((amount, note)), lights, baked, iterations, preview)
    for iteration, loss in zip(range(first, iterations + 1), losses, strict=False):
        watch(iteration, loss, lambda count=7 + iteration: [None] * count)
    return watch, told


@pytest.mark.parametrize("iterations", [1, 3, LOOKS, 4 * LOOKS, 1000])
def test_looks_come_evenly_and_the_last_at_the_end(iterations):
    watch, _ = watched(iterations, np.ones(iterations), lambda baked: (0.5, 20.0))
    assert [look.iteration for look in watch.looks][-1] == iterations
    steps = np.diff([0, *(look.iteration for look in watch.looks)])
    assert set(steps) == {max(iterations // LOOKS, 1)}


def test_a_look_is_at_the_gaussians_of_that_iteration():
    watch, told = watched(4, [0.5] * 4)
    for look in watch.looks:
        assert look.gaussians == 7 + look.iteration
        assert (look.loss, look.psnr) == (1 / look.gaussians, 10 + look.gaussians)
        assert f"held-out {look.psnr:.1f} dB" in told[look.iteration - 1][1]
    assert told[2][1].startswith("loss 0.5000, 10 Gaussians")


def test_the_seconds_of_looking_do_not_count():
    watch, _ = watched(8, np.ones(8), preview=SimpleNamespace(draw=lambda *_: time.sleep(SLOW)))
    seconds = [look.seconds for look in watch.looks]
    assert len(seconds) == 8
    assert seconds == sorted(seconds)
    assert 0 <= seconds[-1] < SLOW  # of 16 * SLOW in all


def test_the_preview_draws_what_is_looked_at():
    drawn = []
    draw = lambda iteration, baked: drawn.append((iteration, 2 + len(baked.gaussians)))  # noqa: E731
    watch, _ = watched(2 * LOOKS, np.ones(2 * LOOKS), lambda *_: (0.5, 20.0), SimpleNamespace(draw=draw))
    assert drawn == [(look.iteration, look.gaussians) for look in watch.looks]


def test_gaussians_that_nobody_looks_at_are_not_asked_for():
    """To make them takes time."""
    asked = []
    baked = lambda gaussians: SimpleNamespace(gaussians=gaussians[2:], coarse=gaussians[:2])  # noqa: E731
    watch = Watch(lambda *_: None, SimpleNamespace(of=lambda baked: (0.5, 20.0)), baked, 4 * LOOKS, None)
    for iteration in range(1, 9):
        watch(iteration, 1.0, lambda iteration=iteration: asked.append(iteration) or [None])
    assert asked == [4, 8]


def test_without_held_out_views_there_is_nothing_to_look_at():
    watch, told = watched(3, np.ones(3), None)
    assert watch.looks == []
    assert [amount for amount, _ in told] == [1, 1, 1]
    assert "held-out" not in told[-1][1]


def test_what_a_checkpoint_had_done_counts_as_done():
    _, told = watched(10, np.ones(10), None, first=8)
    assert [amount for amount, _ in told] == [8, 1, 1]


def test_the_loss_is_a_running_mean():
    """One view is brighter than the next: the mean moves by 1 - MEMORY of the difference."""
    _, told = watched(2, [0.1, 0.9], None)
    shown = [float(note.split(",")[0].removeprefix("loss ")) for _, note in told]
    assert shown == [0.1, pytest.approx(MEMORY * 0.1 + (1 - MEMORY) * 0.9, abs=1e-4)]
