"""Leaks: fields that leak by a known amount through a wall on a floor that runs on below it."""

from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.evaluation.leak import DARK, DEVIATIONS, WORST, Reach, Surroundings, leak
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.scene import Scene

SIZE = 64
REACH = 0.6
LIGHT = 2.0  # of the floor where x < 0
LEAKED = 0.1  # added where 0 < x < BELOW
BELOW = 0.05
WALL = scenes.quad([(0, 0, 1), (0, 0, -1), (0, 1, -1), (0, 1, 1)])
FLOOR = scenes.floor()


def reference(light: np.ndarray, noise: float = 0.0) -> SimpleNamespace:
    """What one sees of the floor from above: x from -1 to 1 along the picture, with B `light` (SIZE,) along x."""
    x, z = np.meshgrid((np.arange(SIZE) + 0.5) / SIZE * 2 - 1, (np.arange(SIZE) + 0.5) / SIZE * 2 - 1)
    position = np.stack([x, np.zeros_like(x), z], axis=2).astype(np.float32)
    normal = np.broadcast_to(np.float32([0, 1, 0]), position.shape)
    clean = image(light)
    rng = np.random.default_rng(0)
    a, b = (clean + np.float32(noise) * rng.normal(size=clean.shape).astype(np.float32) for _ in range(2))
    surface = SimpleNamespace(position=position, geometric_normal=normal)
    valid = np.ones((SIZE, SIZE), bool)
    return SimpleNamespace(surface=surface, clean=clean, indirect_a=a, indirect_b=b, valid=valid)


def image(light: np.ndarray) -> np.ndarray:
    return np.tile(light[None, :, None], (SIZE, 1, 3)).astype(np.float32)


X = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
STEP = np.where(X < 0, LIGHT, 0.0)
LEAKY = np.where((X > 0) & (X < BELOW), LEAKED, STEP)


class Everywhere:
    """A reach of REACH, m, at all points."""

    def at(self, position: np.ndarray) -> np.ndarray:
        return np.full(len(position), REACH)


def measured(shown: np.ndarray, truth: SimpleNamespace, *meshes) -> float | None:
    triangles = Triangles(Scene((FLOOR, *meshes), (scenes.WHITE,)))
    return leak(image(shown), truth, Surroundings.of([truth], triangles, Everywhere()))


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_light_behind_a_wall_is_a_share_of_what_lies_before_it(noise):
    truth = reference(STEP, noise)
    assert measured(LEAKY, truth, WALL) == pytest.approx(LEAKED / LIGHT, abs=0.2 * noise + 1e-6)
    assert measured(STEP, truth, WALL) <= 0.2 * noise


def test_only_the_worst_points_count():
    spot = STEP.copy()
    spot[SIZE // 2] = LEAKED  # a column: more than WORST of the dark points
    assert 1 / (SIZE * REACH) > WORST
    assert measured(spot, reference(STEP), WALL) == pytest.approx(LEAKED / LIGHT)


def test_an_edge_without_an_occluder_is_no_leak():
    assert measured(LEAKY, reference(STEP)) is None


def test_light_out_of_reach_and_faint_light_do_not_leak():
    far = np.where(X < -REACH, LIGHT, 0.0)
    assert measured(np.full(SIZE, LEAKED), reference(far), WALL) is None
    near_as_bright = np.where(X < 0, LIGHT, 2 * DARK * LIGHT)
    assert measured(np.full(SIZE, LIGHT), reference(near_as_bright), WALL) is None


def test_too_little_light_is_no_leak():
    assert measured(np.where(X < 0, 0.0, STEP), reference(STEP), WALL) == 0


def test_the_brightest_patch_is_that_which_rays_find():
    rng = np.random.default_rng(1)
    triangles = Triangles(Scene((FLOOR, WALL), (scenes.WHITE,)))
    on_floor, on_wall = rng.uniform(-1, 1, (400, 3)) * [1, 0, 1], rng.uniform(-1, 1, (400, 3)) * [0, 1, 1]
    on_wall[:, 1] = np.abs(on_wall[:, 1])
    position = np.concatenate([on_floor, on_wall]).astype(np.float32)
    normal = np.zeros_like(position)
    normal[:400, 1], normal[400:, 0] = 1, rng.choice([-1, 1], 400)
    light = 10 ** rng.uniform(-4, 2, 800)
    found = Surroundings(triangles, Everywhere(), position, normal, light).bright_side(position, normal, light)

    near = np.linalg.norm(position[:, None] - position, axis=2) <= REACH
    at, patch = np.nonzero(near & (light[:, None] < DARK * light))
    lifted = triangles.lifted(position, normal)
    hidden = triangles.blocked(lifted[at], lifted[patch])
    expected = np.zeros(800)
    np.maximum.at(expected, at[hidden], light[patch[hidden]])
    assert np.count_nonzero(expected) > 100
    assert np.array_equal(found, expected)


def test_light_is_carried_as_far_as_the_longest_gaussian_that_covers_a_point():
    centre = np.float32([[0, 0, 0], [0, 0, 0], [10, 0, 0]])
    scale = np.float32([[0.1, 0.02, 0.1], [0.01, 1.001 / DEVIATIONS, 0.1], [0.5, 4.001 / DEVIATIONS, 0.1]])
    reach = Reach(SimpleNamespace(position=centre, scale=scale))
    points = np.float32([[0, 0, 0], [0.9, 0, 0], [1.1, 0, 0], [6.1, 0, 0], [10, 0, 3.9], [10, 0, 4.1]])
    assert reach.at(points).tolist() == [1, 1, 0, 4, 4, 0]
    assert Reach(SimpleNamespace(position=centre[:0], scale=scale[:0])).at(points).tolist() == [0] * 6


def test_nothing_leaks_without_gaussians():
    truth, triangles = reference(STEP), Triangles(Scene((FLOOR, WALL), (scenes.WHITE,)))
    nobody = Reach(SimpleNamespace(position=np.zeros((0, 3), np.float32), scale=np.zeros((0, 3), np.float32)))
    assert leak(image(LEAKY), truth, Surroundings.of([truth], triangles, nobody)) is None


@pytest.mark.parametrize(("longest", "leaked"), [((0, 0, 0), LEAKED / LIGHT), ((100, 0, 0), None)])
def test_only_gaussians_that_cover_a_point_leak_there(longest, leaked):
    """The lit part of the floor is further away than the short Gaussians there carry light."""
    lit = np.where(X < -REACH, LIGHT, 0.0)
    gaussians = SimpleNamespace(position=np.float32([[0, 0, 0], longest]), scale=np.float32([[0.15] * 3, [0.5] * 3]))
    gaussians.position[0, 0] = 0.2
    triangles, truth = Triangles(Scene((FLOOR, WALL), (scenes.WHITE,))), reference(lit)
    shown = np.where((X > 0) & (X < BELOW), LEAKED, lit)
    found = leak(image(shown), truth, Surroundings.of([truth], triangles, Reach(gaussians)))
    assert found is None if leaked is None else found == pytest.approx(leaked)
