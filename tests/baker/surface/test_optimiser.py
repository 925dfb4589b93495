"""Steps of the `surface` operator's fit: the gradient against finite differences, and what a step may change."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import oracle
import pytest
from surface_cases import FIELDS, gaussians, of_type, points
from surface_gradient import exactly_moved

from gsgi.baker.native import kernels
from gsgi.baker.surface.colours import SLOPE_BOUND
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.surface.optimiser import BETA_1, MODEL, SIZE_COST, SurfaceOptimiser, moved
from gsgi.baker.surface.samples import SurfaceSamples
from gsgi.baker.surface.state import PARAMETERS, SurfaceState
from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

BLEND = SurfaceBlend()
COUNT, STEP = 12, 1e-6
NOWHERE = dict.fromkeys(PARAMETERS, 0.0)
RATES = dict.fromkeys(PARAMETERS, 0.02)


class Exact(SimpleNamespace):
    """Gaussians of degree 0 in double precision, for the oracle."""

    sh_degree = 0

    def __len__(self) -> int:
        return len(self.position)


@pytest.mark.parametrize("floor", [0.0, 0.1, 10.0])
def test_a_step_follows_the_gradient_of_what_the_oracle_reads(floor):
    """The whole step's: Adam's first mean. The importance is no part of it, the light's own size is. A floor of 10 is
    more than any sample has."""
    given, coarse, blend = gaussians(4, seed=3, sloped=True), gaussians(6, 9, seed=8), SurfaceBlend(floor=floor)
    given.scale[...], coarse.scale[...] = np.maximum(given.scale, 0.3), 1.0
    given.sh[...], coarse.sh[:, :1] = np.abs(given.sh) + 1, np.abs(coarse.sh[:, :1]) + 6  # B is never cut at 0
    position, normal = points(1500)
    weight = oracle.level_sums(given, blend.cutoff, blend.sharpness, position.astype(float), normal)[:, 3]
    chosen = (weight > 1e-3) & (np.abs(weight - floor) > 1e-4)
    position, normal, weight = position[chosen], normal[chosen], weight[chosen]
    assert min((weight < floor).sum(), (weight > floor).sum()) > (50 if floor == 0.1 else -1)
    samples = samples_of(np.ones(position.shape), position, normal)

    def light(gaussians) -> np.ndarray:
        return oracle.read_surface(gaussians, coarse, blend, position.astype(float), normal)[1]

    def loss(change: np.ndarray) -> float:
        changed = Exact(**vars(exactly_moved(of_type(given, np.float64), change)))
        return ((light(changed) - 1) ** 2).sum() / len(position)  # the light is 1 everywhere, and so is the importance

    steps = 1e-5 * np.eye(4 * 15).reshape(-1, 4, 15)
    expected = np.reshape([(loss(step) - loss(-step)) / 2e-5 for step in steps], (4, 15))
    optimiser = SurfaceOptimiser(samples, coarse, blend)
    state, found = optimiser.step(SurfaceState.fresh(given), NOWHERE, 1)
    got = state.mean / (1 - BETA_1)
    one_by_one = (Exact(**{name: column[i : i + 1] for name, column in vars(given).items()}) for i in range(4))
    weights = [
        oracle.level_sums(one, blend.cutoff, blend.sharpness, position.astype(float), normal)[:, 3]
        for one in one_by_one
    ]
    error = ((light(given) - 1) ** 2).sum(axis=1)  # without noise all of the loss is error
    own = (weights / np.maximum(weight, floor) * error).sum(axis=1) / len(position)
    got[:, 6:9] -= SIZE_COST * own[:, None]
    assert found == pytest.approx(loss(np.zeros((4, 15))), rel=1e-4)
    np.testing.assert_allclose(got, expected, atol=1e-4 * np.abs(expected).max())


def test_moved_is_the_move_that_the_gradient_is_of():
    given = gaussians(COUNT, sloped=True)
    given.sh[...] = np.abs(given.sh) + 1
    given.slope[...] /= 2
    change = np.random.default_rng(0).uniform(-0.1, 0.1, (COUNT, 15))
    unit = np.linspace(0.1, 2, COUNT, dtype=np.float32)[:, None]
    result = moved(given, change, unit, np.zeros((COUNT, 3)), np.full((COUNT, 3), np.inf))
    change[:, 10:13] *= unit / constants.SH_C0
    expected = exactly_moved(of_type(given, np.float64), change)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), rtol=2e-5, atol=2e-6, err_msg=name)


def test_a_move_keeps_to_its_limits():
    given = gaussians(COUNT, sloped=True)
    far = np.full((COUNT, 15), 100.0)
    smallest, largest = given.scale / 2, given.scale * 2
    for sign, scale, opacity in ((1, largest, 1 / (1 + np.exp(-5.0))), (-1, smallest, 1 / (1 + np.exp(5.0)))):
        result = moved(given, sign * far, 1.0, smallest, largest)
        np.testing.assert_array_equal(result.scale, scale)
        np.testing.assert_allclose(result.opacity, opacity, rtol=1e-5)
        assert result.sh.min() >= 0
        np.testing.assert_allclose(result.slope, sign * SLOPE_BOUND / 2**0.5, rtol=1e-2)
        np.testing.assert_allclose(np.linalg.norm(result.rotation, axis=1), 1, rtol=1e-6)


@pytest.mark.filterwarnings("error")
def test_opacities_that_were_stored_as_none_or_all_come_within_the_limits():
    given = gaussians(2)
    given.opacity[...] = 0, 1
    result = moved(given, np.zeros((2, 15)), 1.0, given.scale / 2, given.scale * 2)
    np.testing.assert_allclose(result.opacity, 1 / (1 + np.exp([5.0, -5.0])), rtol=1e-5)


def samples_of(light: np.ndarray, position, normal, noise: float = 0.0) -> SurfaceSamples:
    rng = np.random.default_rng(9)
    halves = (light + noise * rng.normal(size=light.shape) for _ in range(2))
    return SurfaceSamples(position, normal, *(half.astype(np.float32) for half in halves), 0)


def wall(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Points of the square [-1, 1]^2 at z = 0, which faces +z."""
    rng = np.random.default_rng(3)
    position = np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)]).astype(np.float32)
    return position, np.tile(np.float32([0, 0, 1]), (count, 1))


def tiles(edge: int = 4) -> Gaussians:
    """Grey, on the wall, one per cell of a grid."""
    x, y = (np.indices((edge, edge)).reshape(2, -1) + 0.5) / edge * 2 - 1
    n = edge**2
    arrays = (
        np.column_stack([x, y, np.zeros(n)]),
        np.tile([0, 0, 0, 1], (n, 1)),
        np.full((n, 3), 1.0 / edge) * [1, 1, 0.3],
        np.full(n, 0.5),
        np.full((n, 1, 3), 2.0),
    )
    return Gaussians(*(array.astype(np.float32) for array in arrays))


def test_the_loss_is_relative_to_the_light_and_the_error_free_of_noise():
    """By hand: with one constant colour B is known, and with it loss and error."""
    position, normal = wall()
    given = tiles()
    b = 2.0 * constants.SH_C0
    target, noise = 0.4, 0.3
    samples = samples_of(np.full((len(position), 3), target), position, normal, noise)
    optimiser = SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend())
    _, loss = optimiser.step(SurfaceState.fresh(given), NOWHERE, 1)
    # The mean brightness of 3 channels in 2 halves has noise / sqrt(6); 4 blocks of 32 samples tell it to 9 %.
    importance = 1 / (target**2 + (noise / 6**0.5 / MODEL) ** 2)
    residual = b - samples.indirect
    assert loss == pytest.approx(importance * (residual**2).sum(axis=1).mean(), rel=0.05)
    # The noise would add 3 noise^2 / 2 to each sample's error, five times what is there; 4000 samples leave 2 %.
    free = importance * 3 * (b - target) ** 2 * len(position)
    noisy = importance * 3 * noise**2 / 2 * len(position)
    assert noisy > 1.5 * free
    assert optimiser.error(given).sum() == pytest.approx(free, abs=0.1 * noisy)


def test_shares_add_up_to_the_samples():
    position, normal = wall()
    samples = samples_of(np.ones((len(position), 3)), position, normal)
    given = tiles()
    share = SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend()).share(given)
    assert share.sum() == pytest.approx(len(position), rel=1e-5)
    np.testing.assert_allclose(share, len(position) / 16, rtol=0.25)  # 250 +- 16 points in each cell
    # Below the floor the rest is the coarse level's share.
    blend = SurfaceBlend(floor=0.4)
    _, weight = look_up(given, tiles(), blend, position, normal)
    assert 0.1 < (weight < 0.4).mean() < 0.9
    share = SurfaceOptimiser(samples, tiles(), blend).share(given)
    assert share.sum() == pytest.approx(np.minimum(1, weight / 0.4).sum(), rel=1e-5)


def test_steps_lead_downhill_and_a_rate_of_zero_nowhere():
    position, normal = wall()
    light = 1 + 0.5 * np.sin(3 * position[:, :1]) * np.ones(3)
    optimiser = SurfaceOptimiser(samples_of(light, position, normal), gaussians(0, 9), SurfaceBlend())
    state = SurfaceState.fresh(tiles())
    same, first = optimiser.step(state, NOWHERE, 1)
    for name in ("position", "scale", "sh"):
        np.testing.assert_allclose(getattr(same.gaussians, name), getattr(tiles(), name), rtol=1e-6, err_msg=name)
    for step in range(1, 61):
        state, seen = optimiser.step(state, RATES, step)
    assert seen < 0.1 * first
    assert (state.gaussians.scale <= state.largest).all()
    assert (state.gaussians.scale >= state.smallest).all()


@pytest.mark.parametrize("apart", [0.1, 5.0])
def test_only_what_both_halves_ask_for_is_done(apart):
    """Grey 0.56 where the mean of the halves is 1: both ask for more light and, as long as the error is not noise, for
    small Gaussians; or one asks for less light and the error might be noise."""
    position, normal = wall()
    half = np.ones((len(position), 3), np.float32)
    samples = SurfaceSamples(position, normal, half + np.float32(apart), half - np.float32(apart), 0)
    optimiser = SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend())
    state, _ = optimiser.step(SurfaceState.fresh(tiles()), RATES, 1)
    agreed = apart < 1
    assert ((state.gaussians.sh > 2) == agreed).all()
    assert (state.gaussians.scale < tiles().scale).all() == agreed
    assert ((state.mean[:, 10:13] < 0) == agreed).all()


def test_halves_that_differ_keep_noise_out():
    """One colour under noise: moving Gaussians add less than half of the noise to the light that they would if both
    halves were alike, so that noise could not be told from light."""
    position, normal = wall()
    nobody = gaussians(0, 9)
    samples = samples_of(np.ones((len(position), 3)), position, normal, 0.5)

    def noise(given: Gaussians) -> float:
        return np.square(look_up(given, nobody, SurfaceBlend(), position, normal)[0] - 1).mean()

    added = []
    for seen in (samples, replace(samples, indirect_a=samples.indirect, indirect_b=samples.indirect)):
        optimiser = SurfaceOptimiser(seen, nobody, SurfaceBlend())
        start = optimiser.solve(tiles(16))
        state = SurfaceState.fresh(start)
        for step in range(1, 61):
            state, _ = optimiser.step(state, RATES, step)
        added.append(noise(state.gaussians) - noise(start))
    assert added[0] < 0.5 * added[1]


def test_a_step_after_a_multiple_of_ten_does_not_know_what_came_before():
    """So a fit that goes on from a checkpoint kept there repeats it to the bit."""
    position, normal = wall()
    samples = samples_of(np.ones((len(position), 3)) * position[:, :1] ** 2, position, normal)
    optimiser = SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend())
    states = [SurfaceState.fresh(tiles(8))]
    for step in range(1, 31):
        states.append(optimiser.step(states[-1], dict.fromkeys(PARAMETERS, 0.1), step)[0])
    fresh = SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend())
    state = states[20]
    for step in range(21, 31):
        state, _ = fresh.step(state, dict.fromkeys(PARAMETERS, 0.1), step)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(state.gaussians, name), getattr(states[step].gaussians, name))


def test_gaussians_that_others_have_exchanged_are_listed_anew():
    """As many as before, but elsewhere: what was listed for the others says nothing of them."""
    position, normal = wall()
    samples = samples_of(np.ones((len(position), 3)) * position[:, :1] ** 2, position, normal)
    optimiser, fresh = (SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend()) for _ in range(2))
    optimiser.step(SurfaceState.fresh(tiles(8)), dict.fromkeys(PARAMETERS, 0.1), 1)
    others = SurfaceState.fresh(Gaussians(*(column[::-1].copy() for column in vars(tiles(8)).values())))
    optimiser.exchanged()
    (found, loss), (expected, expected_loss) = (
        each.step(others, dict.fromkeys(PARAMETERS, 0.1), 2) for each in (optimiser, fresh)
    )
    assert loss == expected_loss
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found.gaussians, name), getattr(expected.gaussians, name))


def test_what_is_not_finite_is_named():
    position, normal = wall()
    light = np.ones((len(position), 3), np.float32)
    given = tiles()
    last = np.abs(position - given.position[15]).max(axis=1).argmin()
    light[last] = np.nan
    given.scale[:15] *= np.float32(0.1)  # only the last reaches the sample
    optimiser = SurfaceOptimiser(samples_of(light, position, normal), gaussians(0, 9), SurfaceBlend())
    with pytest.raises(FloatingPointError, match="gradient of Gaussian 15 is"):
        optimiser.step(SurfaceState.fresh(given), RATES, 1)
    far = samples_of(light, position + np.float32(100), normal)
    with pytest.raises(FloatingPointError, match="the loss is nan"):  # nobody reaches it
        SurfaceOptimiser(far, gaussians(0, 9), SurfaceBlend()).step(SurfaceState.fresh(given), RATES, 1)


def test_nobody_and_no_samples():
    position, normal = wall(100)
    samples = samples_of(np.ones((100, 3)), position, normal)
    optimiser = SurfaceOptimiser(samples, gaussians(0, 9), SurfaceBlend())
    state, seen = optimiser.step(SurfaceState.fresh(gaussians(0)), RATES, 1)
    assert len(state) == 0
    assert seen == pytest.approx(3, rel=1e-6)  # black against white
    optimiser = SurfaceOptimiser(samples[:0], gaussians(0, 9), SurfaceBlend())
    state, seen = optimiser.step(SurfaceState.fresh(tiles()), RATES, 1)
    assert seen == 0
    np.testing.assert_array_equal(state.gaussians.position, tiles().position)


def test_same_bits_for_one_and_two_threads():
    position, normal = wall()
    samples = samples_of(np.abs(position), position, normal, 0.1)
    results = []
    try:
        for threads in (1, 2):
            kernels.set_thread_count(threads)
            optimiser = SurfaceOptimiser(samples, tiles(2), SurfaceBlend())
            state = SurfaceState.fresh(optimiser.solve(tiles(8)))
            for step in range(1, 6):
                state, _ = optimiser.step(state, RATES, step)
            results.append([getattr(state.gaussians, name).tobytes() for name in FIELDS])
    finally:
        kernels.set_thread_count(0)
    assert results[0] == results[1]
