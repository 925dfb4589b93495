"""Holes in the fine level where the coarse one has other light: they are found by tracing, and closed."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from surface_cases import gaussians, samples_of

from gsgi.baker.fitting.rotations import rotation_to
from gsgi.baker.surface.layers import Layer, Points
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.surface.samples import SurfaceSamples, joined
from gsgi.baker.surface.spots import MEMBERS, OFF, false_spots, without_spots
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.constants import SH_C0
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend
from gsgi.runtime.scene import Scene

BLEND = SurfaceBlend()
DARK, BRIGHT, RADIUS = 0.05, 1.0, 0.4
COARSE = replace(
    gaussians(1), position=np.zeros((1, 3), np.float32), scale=np.full((1, 3), 100, np.float32),
    sh=np.full((1, 1, 3), BRIGHT / SH_C0, np.float32),
)  # fmt: skip


def on_floor(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on a square floor of edge 2 around the origin, and their normals."""
    position = np.random.default_rng(seed).uniform(-1, 1, (count, 3)).astype(np.float32)
    position[:, 1] = 0
    return position, np.tile(np.float32([0, 1, 0]), (count, 1))


def points(count: int = 20_000) -> Points:
    position, normal = on_floor(count, 1)
    return Points(position, normal, normal, normal, np.zeros(count, np.int32), np.zeros((count, 2)))


def glanced(light: float, noise: float = 0.0):
    """A glance that finds so much light everywhere."""

    def glance(there: Points) -> Layer:
        count = len(there.position)
        found = samples_of(np.full((count, 3), light), there.position, there.normal, noise)
        return Layer(found.indirect_a, found.indirect_b, *(np.full(count, 32, np.uint8),) * 2, 0)

    return glance


def level(radius: float, bright: float = DARK) -> tuple[SurfaceSamples, Gaussians]:
    """Samples of a floor, and Gaussians on a grid with their light; both without those around the middle."""
    position, normal = on_floor(20_000, 0)
    outside = np.linalg.norm(position, axis=1) >= radius
    samples = samples_of(np.full((outside.sum(), 3), bright), position[outside], normal[outside])
    x, z = (each.ravel() for each in np.meshgrid(*[np.linspace(-1, 1, 25)] * 2))
    grid = np.stack([x, np.zeros_like(x), z], axis=1).astype(np.float32)
    grid = grid[np.linalg.norm(grid, axis=1) >= radius]
    up = np.tile(np.float32([0, 1, 0]), (len(grid), 1))
    scale = np.tile(np.float32([0.08, 0.08, 0.02]), (len(grid), 1))
    light, slope = np.full((len(grid), 1, 3), bright / SH_C0, np.float32), np.zeros((len(grid), 2), np.float32)
    return samples, Gaussians(grid, rotation_to(up), scale, np.full(len(grid), 0.5, np.float32), light, slope)


@pytest.fixture(scope="module")
def holed():
    samples, fitted = level(RADIUS)
    middle = np.zeros((1, 3), np.float32), samples.normal[:1]
    assert look_up(fitted, COARSE, BLEND, *middle)[0].mean() > 0.9 * BRIGHT
    return samples, fitted


def test_a_bright_spot_is_found_and_closed(holed):
    samples, fitted = holed
    found = false_spots(points(), glanced(DARK, 0.2), samples, fitted, COARSE, BLEND, 100)
    away = np.linalg.norm(found.position, axis=1)
    middle = found.radius > 0
    assert 0 < middle.sum() < 20
    assert len(away) == MEMBERS * middle.sum()
    assert away.max() < RADIUS
    traced = samples_of(np.full((len(away), 3), DARK), found.position, found.normal)
    triangles = Triangles(Scene((scenes.floor(1.0),), (scenes.WHITE,)))
    closed = without_spots(found, traced, samples, samples[:0], fitted, COARSE, BLEND, len(fitted) + 1, triangles)
    assert len(closed) == len(fitted) + 1
    gone = set(map(tuple, fitted.position.round(2))) - set(map(tuple, closed.position.round(2)))
    assert len(gone) == middle.sum() - 1
    assert all(max(map(abs, each)) > 0.9 for each in gone)  # those in corners and at edges are seen least
    position, normal = on_floor(20_000, 2)
    inside = np.linalg.norm(position, axis=1) < RADIUS
    before, after = (look_up(each, COARSE, BLEND, position, normal)[0].mean(axis=1) for each in (fitted, closed))
    assert (before[inside] > 2 * DARK).mean() > 0.3
    assert (after[inside] > 2 * DARK).mean() < 0.02
    np.testing.assert_allclose(after[~inside], DARK, rtol=0.1)


def test_a_hole_beside_a_wall_is_closed_without_darkening_what_is_behind():
    """A wall without thickness at x = 0 parts a dark half of the floor, where a strip is open, from a bright one."""
    samples, fitted = level(0.0)
    lit, covers = samples.position[:, 0] < 0, fitted.position[:, 0]
    samples = samples_of(np.where(lit, BRIGHT, DARK)[:, None] * np.ones(3), samples.position, samples.normal)
    samples = samples[lit | (samples.position[:, 0] > 0.1)]
    light = np.where(covers < 0, BRIGHT, DARK)[:, None, None] / np.float32(DARK)
    fitted = replace(fitted, sh=(fitted.sh * light).astype(np.float32))
    fitted = Gaussians(*(column[(covers < -0.2) | (covers > 0.3)] for column in vars(fitted).values()))
    rim = points()
    rim = rim.at((rim.position[:, 0] > 0) & (rim.position[:, 0] < 0.1) & (np.abs(rim.position[:, 2]) < 0.9))
    found = false_spots(rim, glanced(DARK), samples, fitted, COARSE, BLEND, 10)
    assert found.holes.sum() > 1
    traced = samples_of(np.full((len(found.position), 3), DARK), found.position, found.normal)
    triangles = Triangles(Scene((scenes.floor(), *scenes.thin_wall()), (scenes.WHITE,)))
    closed = without_spots(found, traced, samples, samples[:0], fitted, COARSE, BLEND, 1000, triangles)
    position, normal = on_floor(20_000, 2)
    behind = position[:, 0] < -0.002
    before, after = (look_up(each, COARSE, BLEND, position, normal)[0].mean(axis=1) for each in (fitted, closed))
    np.testing.assert_allclose(after[behind], before[behind], rtol=0.01)
    assert after[~behind].mean() < before[~behind].mean()


def test_there_are_no_more_than_asked_for_and_the_widest_come_first(holed):
    samples, fitted = holed
    task = samples, fitted, COARSE, BLEND
    one, many = (false_spots(points(), glanced(DARK), *task, most) for most in (1, 100))
    np.testing.assert_array_equal(one.position[0], many.position[0])
    assert np.linalg.norm(one.position[0]) < RADIUS / 2
    assert (one.radius > 0).sum() == 1
    for most, there in ((0, points()), (9, points().at(slice(0)))):
        assert len(false_spots(there, glanced(DARK), *task, most).position) == 0


@pytest.mark.parametrize("light", [DARK, 0.6 * BRIGHT, BRIGHT, 3 * BRIGHT])
def test_light_that_paths_bring_is_no_spot(holed, light):
    samples, fitted = holed
    found = false_spots(points(), glanced(light), samples, fitted, COARSE, BLEND, 100)
    read, _ = look_up(fitted, COARSE, BLEND, found.position, found.normal)
    assert len(read)
    assert (np.abs(read / light - 1).max(axis=1) > OFF).all()


def test_nobody_looks_at_black(holed):
    samples, fitted = holed
    assert len(false_spots(points(), glanced(0.0, 0.1), samples, fitted, COARSE, BLEND, 100).position) == 0


@pytest.mark.parametrize("colour", [(0.1, 0.1, 0.1), (0.5, 1.0, 1.5)])
def test_spots_may_be_too_dark_or_have_another_colour(colour):
    coarse = replace(COARSE, sh=np.float32(colour).reshape(1, 1, 3) / np.float32(SH_C0))
    found = false_spots(points(), glanced(BRIGHT, 0.1), *level(RADIUS, BRIGHT), coarse, BLEND, 100)
    assert len(found.position)
    assert np.linalg.norm(found.position, axis=1).max() < RADIUS


def test_dark_gaps_in_bright_surroundings_are_none():
    assert len(false_spots(points(), glanced(DARK), *level(RADIUS, BRIGHT), COARSE, BLEND, 100).position) == 0


def test_a_level_without_holes_has_none():
    assert len(false_spots(points(), glanced(DARK), *level(0.0), COARSE, BLEND, 100).position) == 0


def test_a_leak_through_a_floor_is_found_and_cut():
    above, fitted = level(0.0)
    above = above[np.abs(above.position[:, 0]) > 0.3]
    # Below, a wall 1,000 times as bright faces +x. Its only Gaussian leans upwards and reaches the floor.
    below = np.random.default_rng(3).uniform(-1, 1, (5000, 3)).astype(np.float32) * np.float32([0, 0.3, 0.5])
    below -= np.float32([0, 0.35, 0])
    side = np.tile(np.float32([1, 0, 0]), (len(below), 1))
    lit = samples_of(np.full((len(below), 3), 1000 * DARK), below, side)
    leaning = np.float32([[0.95, 0.31, 0]]) / np.hypot(0.95, 0.31)
    bright = Gaussians(
        np.float32([[0, -0.3, 0]]), rotation_to(leaning), np.float32([[0.3, 0.3, 0.1]]), np.ones(1, np.float32),
        np.full((1, 1, 3), 1000 * DARK / SH_C0, np.float32), np.zeros((1, 2), np.float32),
    )  # fmt: skip
    columns = zip(vars(fitted).values(), vars(bright).values(), strict=True)
    both = Gaussians(*(np.concatenate(pair) if pair[0] is not None else None for pair in columns))
    surface = joined([above, lit])
    position, normal = on_floor(20_000, 2)
    inside = np.hypot(position[:, 0], position[:, 2]) < 0.1
    before = look_up(both, COARSE, BLEND, position, normal)[0].mean(axis=1)
    assert before[inside].min() > 3 * DARK

    found = false_spots(points(), glanced(DARK, 0.2), surface, both, COARSE, BLEND, 100)
    assert len(found.position)
    assert not found.radius.any()  # it is no hole
    assert np.abs(found.position[:, 0]).max() < 0.3
    traced = samples_of(np.full((len(found.position), 3), DARK), found.position, found.normal)
    triangles = Triangles(Scene((scenes.floor(1.0),), (scenes.WHITE,)))
    closed = without_spots(found, traced, surface, surface[:0], both, COARSE, BLEND, len(both), triangles)
    after = look_up(closed, COARSE, BLEND, position, normal)[0].mean(axis=1)
    np.testing.assert_allclose(after[inside], DARK, rtol=0.3)
    wall = look_up(closed, COARSE, BLEND, below, side)[0].mean(axis=1)
    assert np.median(wall) > 500 * DARK


def test_light_that_no_sample_around_has_is_no_leak_if_paths_bring_it():
    samples, fitted = level(0.0)
    lit = (fitted.position[:, 0] < 0)[:, None, None]
    fitted = replace(fitted, sh=np.where(lit, BRIGHT / DARK * fitted.sh, fitted.sh))
    samples = samples[samples.position[:, 0] > 0]  # none on the bright side

    def as_read(there: Points) -> Layer:
        light = look_up(fitted, COARSE, BLEND, there.position, there.normal)[0]
        return Layer(light, light, *(np.full(len(light), 32, np.uint8),) * 2, 0)

    task = samples, fitted, COARSE, BLEND, 100
    assert len(false_spots(points(), glanced(DARK), *task).position)
    assert len(false_spots(points(), as_read, *task).position) == 0
