"""Where a thin share of points tells that light has changed."""

import numpy as np

from gsgi.baker.update.thin_share import ASKED, CHANGED, SMOOTHED, ThinShare

COUNT = 4096
UP, DOWN = np.float32([0, 1, 0]), np.float32([0, -1, 0])


def points(seed: int, normal=UP) -> tuple[np.ndarray, np.ndarray]:
    """Points all over a square of edge 2, and their normals."""
    position = np.random.default_rng(seed).uniform(-1, 1, (COUNT, 3)).astype(np.float32)
    position[:, 1] = 0
    return position, np.tile(normal, (COUNT, 1))


def share(change) -> ThinShare:
    """Light of level 2 that has changed by `change(x)`, relative to that, in both halves."""
    position, normal = points(0)
    light = np.repeat(2 * change(position[:, :1]), 3, axis=1).astype(np.float32)
    return ThinShare(position, normal, light, light, np.full(COUNT, 2, np.float32))


def test_where_nothing_has_changed_nothing_is_done():
    verdict = share(lambda x: 0 * x).judge(*points(1))
    assert verdict.same.all()
    assert not np.concatenate([verdict.change[:, None], verdict.shift_a, verdict.shift_b], axis=1).any()


def test_points_are_traced_again_where_light_has_changed():
    where = points(1)
    verdict = share(lambda x: np.where(x > 0, 2 * CHANGED, 0)).judge(*where)
    x = where[0][:, 0]
    np.testing.assert_allclose(verdict.change[abs(x) > 0.2], np.where(x > 0, 2 * CHANGED, 0)[abs(x) > 0.2], rtol=1e-5)
    np.testing.assert_array_equal(verdict.same[abs(x) > 0.2], x[abs(x) > 0.2] < 0)


def test_small_changes_are_passed_on():
    verdict = share(lambda x: CHANGED / 2 * x).judge(*(where := points(1)))
    assert verdict.change.max() < CHANGED
    expected = np.repeat(CHANGED / 2 * where[0][:, :1], 3, axis=1)
    np.testing.assert_allclose(verdict.shift_a, expected, atol=0.05 * CHANGED)


def test_a_bright_place_tells_a_dark_one_beside_it_by_which_share_its_light_has_changed():
    position, normal = points(0)
    level = np.where(position[:, 0] > 0, 1000, 1).astype(np.float32)
    light = np.repeat(-0.02 * level[:, None], 3, axis=1).astype(np.float32)
    verdict = ThinShare(position, normal, light, light, level).judge(*points(1))
    np.testing.assert_allclose(verdict.shift_a, -0.02, rtol=1e-5)


def test_a_dark_place_that_has_changed_tells_a_bright_one_beside_it_of_hardly_any_change():
    position, normal = points(0)
    dark = position[:, 0] < 0
    light = np.repeat(2.0 * dark[:, None], 3, axis=1).astype(np.float32)
    verdict = ThinShare(position, normal, light, light, np.where(dark, 1, 1000).astype(np.float32)).judge(*points(1))
    bright = points(1)[0][:, 0] > 0.02
    assert (verdict.change[bright] < CHANGED).mean() > 0.9
    assert np.abs(verdict.shift_a[bright & (verdict.change < CHANGED)]).max() < 0.05


def test_noise_alone_is_no_change():
    rng = np.random.default_rng(2)
    position, normal = points(0)
    a, b = (rng.normal(0, CHANGED, (COUNT, 3)).astype(np.float32) for _ in range(2))
    verdict = ThinShare(position, normal, a, b, np.ones(COUNT, np.float32)).judge(*points(1))
    assert (verdict.change > CHANGED).mean() < 0.01


def test_other_noise_of_the_same_light_is_hardly_passed_on_and_a_change_beside_it_is():
    rng, noise = np.random.default_rng(3), 0.05
    position, normal = points(0)
    a, b = (rng.normal(0, noise, (COUNT, 3)).astype(np.float32) for _ in range(2))
    where = points(1)

    def passed_on(change: float) -> np.ndarray:
        shares = ThinShare(position, normal, a + np.float32(change), b + np.float32(change), np.ones(COUNT, np.float32))
        verdict = shares.judge(*where)
        return (verdict.shift_a + verdict.shift_b) / 2

    without = noise / np.sqrt(2 * SMOOTHED)  # what the mean over the neighbours has of it
    assert np.sqrt((passed_on(0.0) ** 2).mean()) < 0.6 * without
    np.testing.assert_allclose(passed_on(0.04).mean(), 0.04, rtol=0.05)


def test_nothing_is_known_where_no_point_tells():
    assert np.isinf(share(lambda x: 0 * x).judge(*points(1, DOWN)).change).all()


def test_fewer_points_than_are_asked_suffice():
    whole = share(lambda x: 0 * x + 2 * CHANGED)
    few = ThinShare(*(column[: ASKED // 2] for column in vars(whole).values()))
    np.testing.assert_allclose(few.judge(*points(1)).change, 2 * CHANGED, rtol=1e-5)
