"""Colours by least squares: known models come back, and a dense solver agrees."""

from dataclasses import replace

import numpy as np
import pytest
from surface_cases import field_of, gaussians, points

from gsgi.baker.surface import colours
from gsgi.baker.surface.colours import RIDGE, solve
from gsgi.baker.trace.point_order import coherent
from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians

SHARPNESS = 0
CONVERGED = colours.CONVERGED


@pytest.fixture(autouse=True)
def _to_the_end(monkeypatch):
    """Solutions are exact: they do not end where the residual is small."""
    monkeypatch.setattr(colours, "CONVERGED", 0.0)


def problem(count: int, coefficients: int, samples: int = 3000):
    """Gaussians that overlap, those of the constant term bright enough to be found above 0; and a field of points."""
    truth = gaussians(count, coefficients)
    truth.scale[...] = np.clip(truth.scale, 0.2, 0.4)
    truth.sh[:, 0] = 5 + truth.sh[:, 0]
    position, normal = points(samples)
    order = coherent(position, normal)
    return truth, field_of(truth, position[order], normal[order], sharpness=SHARPNESS)


def black(truth: Gaussians) -> Gaussians:
    return Gaussians(truth.position, truth.rotation, truth.scale, truth.opacity, np.zeros_like(truth.sh))


def base(samples: int, value=(0.0, 0.0, 0.0, 0.0)) -> np.ndarray:
    return np.tile(np.float32(value), (samples, 1))


def light_of(sums: np.ndarray) -> np.ndarray:
    return np.divide(sums[:, :3], sums[:, 3:], out=np.zeros_like(sums[:, :3]), where=sums[:, 3:] > 0)


def colours_of(field, given: Gaussians, base, light, importance, iterations: int, ridge: float = RIDGE) -> np.ndarray:
    """The coefficients that fit light without noise."""
    return solve(field, given, base, light, importance, np.zeros(len(light)), ridge, iterations)[0]


def design(field, truth: Gaussians, inverse: np.ndarray) -> np.ndarray:
    """(S, N K): what each coefficient alone adds to B, in one channel."""
    columns = []
    for i in range(len(truth) * truth.sh.shape[1]):
        sh = np.zeros(truth.sh.shape[:2], np.float32)
        sh.flat[i] = 1
        sh = np.ascontiguousarray(np.repeat(sh[:, :, None], 3, axis=2))
        one = Gaussians(truth.position, truth.rotation, truth.scale, truth.opacity, sh)
        columns.append(field.read(one)[:, 0] * inverse)
    return np.stack(columns, axis=1).astype(float)


# Conjugate gradients end where floats do, at some 1e-6 of the light times the condition of the problem, below 1e3.
@pytest.mark.parametrize(("count", "coefficients"), [(60, 1), (8, 9)])
def test_a_known_model_comes_back(count, coefficients):
    truth, field = problem(count, coefficients)
    light = light_of(field.read(truth))
    found = colours_of(field, black(truth), base(len(light)), light, np.ones(len(light)), 300, ridge=0.0)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, truth.sh, atol=5e-3)


def test_the_ridge_costs_little():
    truth, field = problem(60, 1)
    light = light_of(field.read(truth))
    found = colours_of(field, black(truth), base(len(light)), light, np.ones(len(light)), 50)
    fitted = field.read(Gaussians(truth.position, truth.rotation, truth.scale, truth.opacity, found))
    error = np.sqrt(np.square(light_of(fitted) - light).mean())
    assert error < 0.02 * light.std()


def test_one_colour_for_all_is_exact_with_the_ridge():
    """The mean that the ridge holds to is that colour."""
    truth, field = problem(60, 1)
    truth.sh[...] = 3 / np.float32(constants.SH_C0)
    light = light_of(field.read(truth))
    found = colours_of(field, black(truth), base(len(light)), light, np.ones(len(light)), 50)
    reached = field.transposed(truth, np.ones_like(light), np.ones(len(light), np.float32))[:, 0] > 0
    np.testing.assert_allclose(found[reached], truth.sh[reached], rtol=1e-4)


@pytest.mark.parametrize(("count", "coefficients"), [(30, 1), (6, 9)])
def test_a_dense_solver_agrees(count, coefficients):
    """numpy.linalg.lstsq of sqrt(importance) B = light, and one row of the ridge for each coefficient."""
    truth, field = problem(count, coefficients, 1000)
    rng = np.random.default_rng(2)
    further = base(1000, (0.3, 0.2, 0.1, 0.2))
    light = light_of(field.read(truth) + further) + rng.uniform(-0.1, 0.1, (1000, 3)).astype(np.float32)
    importance = rng.uniform(0.2, 5, 1000)
    found = colours_of(field, black(truth), further, light, importance, 300)
    assert (found[:, 0] > 0).all()  # else the limit at 0 would take part
    inverse = 1 / (field.read(truth) + further)[:, 3]
    rows = design(field, truth, inverse)
    given = further[:, :3] * inverse[:, None]
    share = rows.reshape(1000, count, coefficients)[:, :, 0] / constants.SH_C0
    mass = (importance[:, None] * share).sum(axis=0)
    prior = np.zeros((count, coefficients, 3))
    prior[:, 0] = (importance[:, None] * share).T @ (light - given) / (mass[:, None] * constants.SH_C0)
    ridge = np.repeat(np.sqrt(RIDGE * constants.SH_C0**2 * mass), coefficients)
    root = np.sqrt(importance)[:, None]
    left = np.concatenate([root * rows, np.diag(ridge)])
    right = np.concatenate([root * (light - given), ridge[:, None] * prior.reshape(-1, 3)])
    expected = np.linalg.lstsq(left, right, rcond=None)[0].reshape(found.shape)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_few_steps_from_close_by_are_enough():
    truth, field = problem(60, 1)
    light = light_of(field.read(truth))
    close = Gaussians(truth.position, truth.rotation, truth.scale, truth.opacity, truth.sh * np.float32(1.1))
    best = colours_of(field, black(truth), base(len(light)), light, np.ones(len(light)), 200)
    found = colours_of(field, close, base(len(light)), light, np.ones(len(light)), 5)
    assert np.abs(found - best).mean() < 0.2 * np.abs(close.sh - best).mean()


def test_others_make_up_for_what_is_fixed():
    truth, field = problem(60, 1)
    light = light_of(field.read(truth))
    fixed = np.arange(60) % 2 == 0
    off = replace(truth, sh=np.where(fixed[:, None, None], truth.sh * np.float32(1.1), truth.sh))
    found, _ = solve(field, off, base(len(light)), light, np.ones(len(light)), np.zeros(len(light)), 0.0, 200, fixed)
    np.testing.assert_array_equal(found[fixed], off.sh[fixed])

    def error(sh: np.ndarray) -> float:
        return float(np.square(light_of(field.read(replace(off, sh=sh))) - light).mean())

    assert error(found) < 0.9 * error(off.sh)


def test_gaussians_that_no_sample_sees_stay_finite_and_as_they_are():
    truth, _ = problem(20, 9)
    truth.position[::2] += np.float32(100)
    truth.opacity[1] = 0
    position, normal = points(500)
    field = field_of(truth, position, normal, sharpness=SHARPNESS)
    light = np.ones((500, 3), np.float32)
    found = colours_of(field, truth, base(500), light, np.ones(500), 20)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[::2], truth.sh[::2])
    np.testing.assert_array_equal(found[1], truth.sh[1])
    assert (found[3] != truth.sh[3]).any()


@pytest.mark.parametrize("samples", [0, 1])
def test_hardly_any_samples(samples):
    truth, _ = problem(20, 1)
    position, normal = points(samples)
    field = field_of(truth, position, normal, sharpness=SHARPNESS)
    found = colours_of(field, truth, base(samples), np.full((samples, 3), 2, np.float32), np.ones(samples), 20)
    assert np.isfinite(found).all()
    nobody = gaussians(0)
    field.list(nobody, 0.05, SHARPNESS, 1.0)
    assert colours_of(field, nobody, base(samples), np.ones((samples, 3), np.float32), np.ones(samples), 5).shape == (
        0,
        1,
        3,
    )


def test_coefficients_are_no_larger_than_light_can_have_them(monkeypatch):
    """Normals that differ little, and light that does: least squares alone find slopes beyond that."""
    truth, _ = problem(1, 9)
    position, normal = points(400)
    normal = np.float32([0, 0, 1]) + np.float32(0.2) * normal
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    field = field_of(truth, position, normal, sharpness=SHARPNESS)
    light = np.where(normal[:, :1] > 0.15, 1, 0) * np.ones(3, np.float32)
    arguments = field, black(truth), base(400), light, np.ones(400), 50
    found = colours_of(*arguments)
    assert np.abs(found[:, 1:]).max() <= colours.SH_BOUND * found[:, 0].max() * (1 + 1e-6)
    monkeypatch.setattr(colours, "SH_BOUND", 1e9)
    beyond = colours_of(*arguments)
    assert np.abs(beyond[:, 1:]).max() > 2.5 * beyond[:, 0].max()


def test_a_colour_below_0_is_none():
    """What lies under the Gaussian alone brings more than there is."""
    truth, field = problem(1, 1)
    found = colours_of(field, truth, base(3000, (5, 5, 5, 1)), np.full((3000, 3), 0.1), np.ones(3000), 5)
    np.testing.assert_array_equal(found, np.zeros((1, 1, 3)))


def test_an_importance_of_zero_is_no_sample():
    truth, field = problem(20, 1)
    light = light_of(field.read(truth))
    importance = np.ones(len(light))
    spoiled = light.copy()
    spoiled[::7], importance[::7] = 1e3, 0
    a, b = (colours_of(field, black(truth), base(len(light)), x, importance, 30) for x in (light, spoiled))
    np.testing.assert_allclose(a, b, rtol=1e-4)


def sloped_problem(count: int = 60, samples: int = 3000):
    """Gaussians with slopes within their bound; the same ones without slopes and a little darker; and their field."""
    truth, field = problem(count, 1, samples)
    truth = replace(truth, slope=np.random.default_rng(4).uniform(-0.15, 0.15, (count, 2)).astype(np.float32))
    return truth, replace(truth, sh=truth.sh * np.float32(0.9), slope=np.zeros_like(truth.slope)), field


def test_known_slopes_come_back(monkeypatch):
    monkeypatch.setattr(colours, "SLOPE_RIDGE", 0.0)
    truth, start, field = sloped_problem()
    light = light_of(field.read(truth))
    ones, quiet = np.ones(len(light)), np.zeros(len(light))
    sh, slope = solve(field, start, base(len(light)), light, ones, quiet, 0.0, 300)
    assert (sh.dtype, slope.dtype) == (np.float32, np.float32)
    np.testing.assert_allclose(slope, truth.slope, atol=2e-3)
    np.testing.assert_allclose(sh, truth.sh, rtol=2e-3)


def test_what_changes_linearly_needs_slopes():
    """Light on a wall that grows along one edge: with slopes half of the error is left at most."""
    rng = np.random.default_rng(1)
    position = np.column_stack([rng.uniform(-1, 1, (4000, 2)), np.zeros(4000)]).astype(np.float32)
    normal = np.tile(np.float32([0, 0, 1]), (4000, 1))
    x, y = (np.indices((3, 3)).reshape(2, -1) - 1) * np.float32(0.66)
    n = len(x)
    arrays = np.column_stack([x, y, 0 * x]), np.tile([0, 0, 0, 1], (n, 1)), np.full((n, 3), 0.5), np.ones(n)
    flat = Gaussians(*(array.astype(np.float32) for array in arrays), np.full((n, 1, 3), 2, np.float32))
    sloped = replace(flat, slope=np.zeros((n, 2), np.float32))
    field = field_of(flat, position, normal, sharpness=SHARPNESS)
    light = np.repeat(1 + 0.6 * position[:, :1], 3, axis=1)
    error = []
    for given in (flat, sloped):
        sh, slope = solve(field, given, base(4000), light, np.ones(4000), np.zeros(4000))
        error.append(np.square(light_of(field.read(replace(given, sh=sh, slope=slope))) - light).mean())
    assert error[1] < 0.25 * error[0]


def test_slopes_are_bounded_and_colours_fit_those_that_are_left():
    truth, start, field = sloped_problem(20)
    truth = replace(truth, slope=6 * truth.slope)
    light = light_of(field.read(truth))
    samples = base(len(light)), light, np.ones(len(light)), np.zeros(len(light))
    sh, slope = solve(field, start, *samples)
    assert np.linalg.norm(slope, axis=1).max() == pytest.approx(colours.SLOPE_BOUND, rel=1e-5)

    def error(colour) -> float:
        return np.square(light_of(field.read(replace(start, sh=colour, slope=slope))) - light).mean()

    assert error(sh) < error(sh * np.float32(1.01))
    assert error(sh) < error(sh * np.float32(0.99))


@pytest.mark.parametrize(("noise", "most"), [(0.2, 0.99), (3.0, 0.5)])
def test_noise_shrinks_slopes(noise, most):
    """Flat light under noise: the noisier the samples are said to be, the less of it becomes slopes."""
    truth, start, field = sloped_problem(60, 1000)
    light = light_of(field.read(replace(truth, slope=None)))
    noisy = light * np.random.default_rng(3).normal(1, 0.2, (len(light), 1)).astype(np.float32)
    importance = np.ones(len(light))

    def steepness(said: float) -> float:
        return np.square(solve(field, start, base(len(light)), noisy, importance, np.full(len(light), said))[1]).mean()

    assert steepness(noise) < most * steepness(0.0)


def test_slopes_of_black_gaussians_stay_finite():
    _, start, field = sloped_problem(20)
    black_start = replace(start, sh=np.zeros_like(start.sh), slope=np.full_like(start.slope, 0.1))
    light = np.zeros((3000, 3), np.float32)
    sh, slope = solve(field, black_start, base(3000), light, np.ones(3000), np.zeros(3000))
    np.testing.assert_array_equal(sh, 0)
    np.testing.assert_array_equal(slope, 0)


def test_iterations_go_on_until_the_residual_is_small(monkeypatch):
    """Where light that leaks counts a million times, as on the dark side of a wall, it takes more of them."""
    monkeypatch.setattr(colours, "CONVERGED", CONVERGED)
    rng = np.random.default_rng(0)
    near, behind, right = rng.random((400, 40)), 0.01 * rng.random((20, 40)), rng.normal(size=(40, 1))
    counts = []
    for importance in (0.0, 1e6):
        matrix = near.T @ near + importance * behind.T @ behind + 10 * np.eye(40)
        preconditioner, applied = 1 / np.diag(matrix)[:, None], []

        def apply(x: np.ndarray, matrix=matrix, applied=applied) -> np.ndarray:
            applied.append(x)
            return matrix @ x

        x = colours.conjugate_gradients(apply, right, np.zeros((40, 1)), preconditioner, 1000)
        left = right - matrix @ x
        assert (left * preconditioner * left).sum() <= 1.01 * CONVERGED * (right * preconditioner * right).sum()
        counts.append(len(applied))
    assert counts[1] > 2 * counts[0]
    monkeypatch.setattr(colours, "CONVERGED", 1.0)
    colours.conjugate_gradients(apply, right, x, preconditioner, 1000)
    assert len(applied) == counts[1] + 1 + colours.LEAST
