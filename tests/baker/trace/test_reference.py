"""References: which paths their pixels take."""

import numpy as np
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
