"""Black samples of closed spaces beside lit surfaces."""

import numpy as np
import pytest
import scenes
from surface_cases import samples_of

from gsgi.baker.fitting.schedule import Schedule
from gsgi.baker.surface import unlit
from gsgi.baker.surface.coarse import coarse_level
from gsgi.baker.surface.fit import fit_surface
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.surface.samples import SurfaceSamples, joined
from gsgi.baker.surface.unlit import ADAPTED, MOST, NEAREST, beside_light
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gaussians import SurfaceBlend
from gsgi.runtime.scene import Scene

FLOOR = scenes.floor()
PARTED, OPEN = (Triangles(Scene((FLOOR, *walls), (scenes.WHITE,))) for walls in (scenes.thin_wall(), []))
LIT, BLACK = 4000, 250  # samples of the floor where x < 0, which is lit, and behind the wall
BLEND = SurfaceBlend()


def floor(low: float, high: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on the floor between two x, and their normals."""
    position = np.random.default_rng(seed).uniform((low, 0, -1), (high, 0, 1), (count, 3)).astype(np.float32)
    return position, np.tile(np.float32([0, 1, 0]), (count, 1))


def samples() -> SurfaceSamples:
    """Of a light of 1 where x < 0, and few where it is black."""
    parts = [
        samples_of(np.full((count, 3), light, np.float32), *floor(*span, count, seed), 0.0)
        for seed, (count, light, span) in enumerate([(LIT, 1.0, (-1, 0)), (BLACK, 0.0, (0, 1))])
    ]
    return joined(parts)


@pytest.fixture
def all_of_them(monkeypatch):
    """No limit: of so few samples, many lie beside the wall."""
    monkeypatch.setattr(unlit, "MOST", 1.0)


def test_points_beside_light_behind_a_wall_are_chosen(all_of_them):
    found = beside_light(*floor(0, 1, 4000, 2), samples(), PARTED)
    apart = 1 / np.sqrt(BLACK / 2)  # of the black samples
    assert len(found)
    assert found.position[:, 0].max() < NEAREST * apart
    assert (floor(0, 1, 4000, 2)[0][:, 0] < 0.2 * apart).sum() <= len(found)  # all that are next to the wall
    assert not found.indirect.any()
    np.testing.assert_allclose(found.seen, ADAPTED, rtol=1e-5)


def test_points_that_see_light_or_no_other_light_are_not():
    few = samples()
    assert not len(beside_light(*floor(0, 1, 4000, 2), few, OPEN))
    assert not len(beside_light(*floor(-1, -0.001, 4000, 2), few, PARTED))
    position, normal = floor(0, 1, 4000, 2)
    assert not len(beside_light(position, -normal, few, PARTED))
    assert not len(beside_light(position, normal, few[LIT:], PARTED))
    for nobody, points in ((few[:0], (position, normal)), (few, (position[:0], normal[:0]))):
        assert not len(beside_light(*points, nobody, PARTED))


def test_they_are_few_beside_all_others():
    few = samples()
    found = beside_light(*floor(0, 0.01, 20000, 2), few, PARTED)
    assert len(found) == int(MOST * len(few))
    assert np.ptp(found.position[:, 2]) > 1.9  # from all of them


def test_a_fit_with_them_leaks_little_light_under_the_wall(all_of_them):
    few, strip = samples(), floor(0.001, 0.03, 2000, 3)
    space = samples_of(np.zeros((64, 3), np.float32), *floor(0, 1, 64, 4), 0.0)
    coarse = coarse_level(space, 1, BLEND, 0, PARTED)

    def leak(traced: SurfaceSamples) -> float:
        fine = fit_surface(traced, space[:0], coarse, BLEND, Schedule(60, 60, 0), triangles=PARTED)
        light = look_up(fine, coarse, BLEND, *strip)[0].mean(axis=1)
        beside = look_up(fine, coarse, BLEND, *floor(-0.2, -0.03, 2000, 3))[0].mean(axis=1)
        assert np.median(beside) == pytest.approx(1, abs=0.05)
        return float(light.mean())

    more = beside_light(*floor(0, 1, 4000, 2), few, PARTED)
    assert leak(joined([few, more])) < 0.03 < 0.1 < leak(few)
