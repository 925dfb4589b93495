"""Boxes of sectors: neighbours, and weights that add up to 1."""

import numpy as np
import worlds

from gsgi.runtime.world.boxes import classes, fading, neighbours, overlap, windows


def total(boxes: np.ndarray, points: np.ndarray, margin: float = 0.3) -> np.ndarray:
    return sum(windows(box, margin, points) for box in fading(boxes, neighbours(boxes), margin))


def test_neighbours_share_a_part_of_a_face_not_only_an_edge():
    boxes = worlds.cells(2, 1, 2)
    assert neighbours(boxes) == [(1, 2), (0, 3), (0, 3), (1, 2)]
    assert neighbours(boxes[[0, 3]]) == [(), ()]
    aside = worlds.cells(2, 1, 1)
    aside[1, :, 1] += 1.5
    assert neighbours(aside) == [(1,), (0,)]


def test_only_a_shared_volume_is_an_overlap():
    boxes = worlds.cells(3, 2, 2)
    assert overlap(boxes) is None
    boxes[7, 0] -= 0.01
    assert overlap(boxes) == (0, 7)


def test_no_two_sectors_of_a_class_have_light_at_the_same_point():
    points = np.random.default_rng(4).uniform(-1, 9, (3000, 3)) * (1, 0.5, 1)
    for boxes, most in ((worlds.cells(4, 1, 4), 4), (worlds.cells(3, 2, 3), 8), (worlds.cells(5, 1, 1), 2)):
        found = classes(boxes, 0.3)
        assert found.max() + 1 == most
        lit = np.array([windows(box, 0.3, points) > 0 for box in fading(boxes, neighbours(boxes), 0.3)])
        inside = ((points > boxes.min(axis=(0, 1))) & (points < boxes.max(axis=(0, 1)))).all(axis=1)
        assert max(lit[found == k][:, inside].sum(axis=0).max() for k in range(most)) == 1


def test_weights_add_up_to_one_everywhere():
    points = np.random.default_rng(1).uniform(-3, 9, (4000, 3))
    np.testing.assert_allclose(total(worlds.cells(3, 2, 3), points), 1, atol=1e-5)
    boxes = worlds.cells(2, 1, 1)
    boxes = np.concatenate([boxes[:1], *(boxes[1:] * (1, 1, 0.5) + (0, 0, shift) for shift in (0, 1))])
    np.testing.assert_allclose(total(boxes, points), 1, atol=1e-5)  # two small boxes beside a large one


def test_light_fades_only_where_a_neighbour_takes_over():
    boxes = worlds.cells(2, 1, 1)
    first = fading(boxes, neighbours(boxes), 0.3)[0]
    x = np.array([-9.0, 1, 1.7, 2, 2.15, 2.3, 4])
    weights = windows(first, 0.3, np.stack([x, x * 0 + 9, x * 0], axis=1))
    np.testing.assert_allclose(weights, [1, 1, 1, 0.5, 0.25, 0, 0], atol=1e-6)


def test_a_sector_behind_a_gap_has_no_light_in_another_one():
    boxes = worlds.cells(6, 1, 3)[[0, 1, 4, 8, 17]]  # the third and the fourth touch along an edge
    reach = fading(boxes, neighbours(boxes), 0.3)
    points = np.random.default_rng(5).uniform(0, 1, (2000, 3))
    edge = np.array([4.0, 4.0])  # x and z of that edge
    for number, (low, high) in enumerate(boxes):
        margin = 0.3 * np.isin(boxes[number], boxes[list(neighbours(boxes)[number])])  # of the faces that it shares
        inside = low + margin[0] + points * (high - low - margin.sum(axis=0))
        away = np.linalg.norm(inside[:, [0, 2]] - edge, axis=1) > 0.3 * 2**0.5 * 2
        there = [windows(reach[k], 0.3, inside) for k in range(len(boxes))]
        assert [weight[away].max() for weight in there] == [float(k == number) for k in range(len(boxes))]
        np.testing.assert_array_equal(there[number], 1)
    between = np.array([[1.0, 1, 6.0], [1, 1, 6.15]])
    gap = worlds.cells(1, 1, 6)[[0, 5]]  # from z = 2 to 10: both end at 6
    np.testing.assert_allclose(windows(fading(gap, neighbours(gap), 0.3)[0], 0.3, between), [0.5, 0.25], atol=1e-6)
    np.testing.assert_allclose(total(gap, np.random.default_rng(6).uniform(-3, 15, (900, 3))), 1, atol=1e-5)


def test_around_a_sector_that_is_missing_weights_are_no_less_than_one():
    points = np.random.default_rng(2).uniform(-1, 5, (4000, 3)) * (1, 0, 1)
    there = total(worlds.cells(2, 1, 2)[:3], points)
    assert there.min() > 1 - 1e-5
