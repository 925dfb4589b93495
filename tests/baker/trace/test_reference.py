"""References: which paths their pixels take, and what the denoiser leaves of their light."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.trace import reference
from gsgi.baker.trace.tracer import Sampling, Tracer

WIDTH, HEIGHT, SAMPLES = 10, 6, 40
EACH = 64  # paths of a pixel, in whole passes


def test_the_pixels_of_a_square_share_out_the_paths_of_one_point():
    numbers = reference.path_numbers(WIDTH, HEIGHT, Sampling(SAMPLES), seed=3)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    assert (numbers[..., 0] == y // 4 * 3 + x // 4).all()
    whole = numbers[:4, :8, 1].reshape(4, 2, 4).swapaxes(0, 1).reshape(2, 16)
    assert (np.sort(whole) == EACH * np.arange(16)).all()
    assert (whole[0] != whole[1]).any()
    quarter = numbers[:2, :2, 1].ravel() // EACH
    assert (np.sort(quarter) == quarter.min() + np.arange(4)).all()
    assert quarter.min() % 4 == 0
    assert len(np.unique(numbers.reshape(-1, 2), axis=0)) == WIDTH * HEIGHT


def test_a_reference_takes_these_paths():
    tracer = Tracer(scenes.spot_room())
    camera = scenes.inside_camera()
    truth = reference.trace(tracer, camera, WIDTH, HEIGHT, 2 * SAMPLES, seed=3)
    seen = truth.surface.diffuse
    numbers = reference.path_numbers(WIDTH, HEIGHT, Sampling(SAMPLES), seed=3)[seen]
    some = np.arange(0, np.count_nonzero(seen), 9)
    points = (column[some] for column in truth.surface.shading_points())
    halves = tracer.halves(*points, Sampling(SAMPLES), 3, numbers=numbers[some])
    for half, image in zip(halves, (truth.indirect_a, truth.indirect_b), strict=True):
        assert half.mean.any()
        assert (half.mean == image[seen][some]).all()


@pytest.mark.parametrize(("share", "least", "most"), [(0.0, -0.02, 0.02), (0.5, 0.3, 0.6)])
def test_the_light_that_the_denoiser_leaves_out_is_known(share, least, most):
    traced = reference.trace(Tracer(scenes.spot_room()), scenes.inside_camera(), 64, 64, 2, seed=0)
    rng = np.random.default_rng(0)
    # This share of the light comes in one pixel of 100, the rest in all.
    bright = rng.random((2, 64, 64, 1)) < 0.01
    a, b = np.float32((1 - share) * rng.gamma(4, 0.25, (2, 64, 64, 3)) + share * 100 * bright)
    assert least < replace(traced, indirect_a=a, indirect_b=b).lost < most
