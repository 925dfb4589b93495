"""Points and segments in boxes."""

import numpy as np

from gsgi.baker.views.boxes import crossing, in_box


def test_segments_cross_the_boxes_that_points_on_them_lie_in():
    rng = np.random.default_rng(4)
    boxes = np.array([[[-1.0, -0.5, -1], [0.7, 1, 0.9]], [[1.5, -2, -2], [1.6, 2, 2]]])
    start, end = rng.uniform(-2, 2, (2, 2000, 3))
    end[:500] = start[:500] * [1, 0, 1] + end[:500] * [0, 1, 0]  # along an axis
    crosses = crossing(boxes, start, end)
    along = np.linspace(0, 1, 2001)[:, None, None]
    points = (start + along * (end - start)).reshape(-1, 3)
    sampled = np.any([in_box(box, points) for box in boxes], axis=0).reshape(2001, -1).any(axis=0)
    assert not (sampled & ~crosses).any()
    assert (crosses & ~sampled).mean() < 0.003
    assert 0.2 < crosses.mean() < 0.8


def test_a_segment_crosses_a_box_that_it_ends_on():
    box = np.array([[[-1.0, -1, -1], [1, 1, 1]]])
    start, end = np.array([[0.3, 5.0, 0.2]]), np.array([[0.3, 1.0, 0.2]])
    assert crossing(box, start, end).all()
    assert crossing(box, end, start).all()
    assert not crossing(box, start, end + np.array([0, 0.01, 0])).any()
    assert not crossing(np.empty((0, 2, 3)), start, end).any()
