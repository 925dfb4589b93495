"""The fit of the `surface` operator: it finds light through noise, keeps its budget, and repeats itself to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from surface_cases import FIELDS, gaussians, samples_of

from gsgi.baker.cache import checkpoint as checkpoint_module
from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.store import Cache, entries, task_key
from gsgi.baker.fitting.rotations import axes
from gsgi.baker.over.fit import Schedule
from gsgi.baker.over.initialise import spacing
from gsgi.baker.over.rasterise import set_thread_count
from gsgi.baker.surface import fit as fitting
from gsgi.baker.surface.fit import fit_again, fit_surface
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.surface.optimiser import SurfaceOptimiser
from gsgi.baker.surface.samples import SurfaceSamples
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend

BLEND = SurfaceBlend()
NOBODY = gaussians(0, 9)


def corner(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points of three walls of 2 x 2 m that meet in a corner, and their normals."""
    rng = np.random.default_rng(seed)
    axis = rng.integers(3, size=count)
    normal = np.eye(3)[axis]
    position = np.where(normal > 0, 0, rng.uniform(0, 2, (count, 3)))
    return position.astype(np.float32), normal.astype(np.float32)


def field(position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Smooth light that is another on each wall, with the edge of a shadow across the floor."""
    wave = 1 + 0.3 * np.sin(2 * position @ [1.0, 0.7, -0.5]) + normal @ [0.0, 0.5, -0.3]
    shadow = 1 / (1 + np.exp(-12 * (position[:, 0] - position[:, 2]) * normal[:, 1]))
    return (wave * (0.4 + shadow))[:, None].astype(np.float32) * np.float32([1, 0.8, 0.6])


def noisy(count: int = 20_000, noise: float = 0.3) -> SurfaceSamples:
    """Halves with independent noise, relative to the light."""
    points = corner(count)
    return samples_of(field(*points), *points, noise)


def fit(course: Schedule, watch=None, checkpoint=None, samples=None) -> Gaussians:
    samples = noisy() if samples is None else samples
    return fit_surface(samples, samples[:0], NOBODY, BLEND, course, watch, checkpoint)


def relative_error(fitted: Gaussians) -> float:
    """Root mean square, of B free of noise, at points that were not fitted."""
    points = corner(5000, seed=1)
    expected = field(*points)
    light, _ = look_up(fitted, NOBODY, BLEND, *points)
    return float(np.sqrt(np.mean(((light - expected) / expected) ** 2)))


def assert_same(a: Gaussians, b: Gaussians):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_it_finds_light_through_noise():
    """The samples are off by 0.3 / sqrt(2) = 21 %; there are 100 for each Gaussian."""
    start = relative_error(fit(Schedule(200, 0)))
    error = relative_error(fit(Schedule(200, 100)))
    assert error < 0.05
    assert error < 0.75 * start


def test_more_gaussians_come_closer():
    samples = noisy(noise=0.0)
    few, many = (relative_error(fit(Schedule(budget, 100), samples=samples)) for budget in (30, 300))
    assert many < 0.5 * few
    assert many < 0.025


def everywhere(light: float) -> Gaussians:
    """A coarse level of one colour."""
    return replace(
        gaussians(1), position=np.ones((1, 3), np.float32), scale=np.full((1, 3), 100, np.float32),
        sh=np.full((1, 1, 3), light * np.sqrt(4 * np.pi), np.float32),
    )  # fmt: skip


def test_the_fine_level_says_what_the_coarse_one_lacks():
    """Below a floor that high the coarse level, about as dark as the darkest wall, always has its share: the fine one
    has to make up for it, and without it light is missing."""
    coarse, blend, points = everywhere(0.25), SurfaceBlend(floor=6.0), corner(5000, seed=1)
    samples = noisy(noise=0.0)
    fitted = fit_surface(samples, samples[:0], coarse, blend, Schedule(200, 60))
    light, weight = look_up(fitted, coarse, blend, *points)
    alone, _ = look_up(fitted, NOBODY, blend, *points)
    assert (weight < blend.floor).mean() > 0.9
    error, without = (np.sqrt(np.mean((b / field(*points) - 1) ** 2)) for b in (light, alone))
    assert error < 0.05
    assert without > 2 * error


def free(count: int, seed: int, low: float, high: float) -> SurfaceSamples:
    """From `low` to `high` (m) before the walls, where light is 2 for every normal."""
    position, normal = corner(count, seed)
    rng = np.random.default_rng(seed)
    position = np.maximum(position + rng.uniform(low, high, (count, 1)) * normal, low)
    any_normal = rng.normal(size=(count, 3))
    any_normal /= np.linalg.norm(any_normal, axis=1, keepdims=True)
    return samples_of(np.full((count, 3), 2.0), position.astype(np.float32), any_normal.astype(np.float32))


def test_samples_in_free_space_keep_the_fine_level_out_of_it():
    """Where the coarse level is right already. The walls pay: Gaussians there have to be thin and narrow."""
    samples, coarse, budget = noisy(noise=0.0), everywhere(2), 200
    at_start = fitting.start(samples, round(fitting.START_SHARE * budget), np.random.default_rng(0))
    near, reach = 0.2, BLEND.radius * float(np.median(at_start.scale[:, 2]))
    assert near < 0.75 * reach  # all further points are out of reach anyway
    errors, points, there = [], corner(5000, seed=1), free(5000, 7, near, reach)
    for known in (samples[:0], free(20_000, 6, near, reach)):
        fitted = fit_surface(samples, known, coarse, BLEND, Schedule(budget, 60))
        before, _ = look_up(fitted, coarse, BLEND, there.position, there.normal)
        on_walls, _ = look_up(fitted, coarse, BLEND, *points)
        errors.append((np.abs(before / 2 - 1).mean(), np.sqrt(np.mean((on_walls / field(*points) - 1) ** 2))))
    # Half way to the reach, the weight of a wall's Gaussians exceeds the floor for normals within 60 degrees of the
    # wall's, a quarter of all. They get the light of the wall: on average that is 61 % off, 15 % over all normals. The
    # fit makes the Gaussians thinner, which may cost a third of it.
    off = np.abs(field(*points) / 2 - 1).mean()
    assert errors[0][0] > 2 / 3 * off / 4
    assert errors[1][0] < 0.2 * errors[0][0]
    assert errors[1][1] < 0.08  # 0.2 m is one distance between neighbours


def test_there_are_no_holes_between_samples_where_another_light_is_before_the_walls():
    """Free space keeps the weights of the fine level low: a little lower between samples, it would show through."""
    samples, points = noisy(noise=0.0), corner(20_000, seed=1)
    before, worst = free(10_000, 3, 0.02, 0.5), []
    for seed in range(5):
        fitted = fit_surface(samples, before, everywhere(2), BLEND, Schedule(200, 100, seed))
        light, weight = look_up(fitted, everywhere(2), BLEND, *points)
        assert weight.min() > BLEND.floor
        worst.append(np.abs(light / field(*points) - 1).mean(axis=1).max())
    assert np.median(worst) < 0.25  # one fit of ten has a point that is 0.3 off


@pytest.mark.parametrize("budget", [0, 1, 2, 7, 60, 200])
def test_there_are_never_more_gaussians_than_the_budget(budget):
    counts = []
    samples = noisy(4000)
    fitted = fit(Schedule(budget, 20), lambda _, __, now: counts.append(len(now())), samples=samples)
    assert len(counts) == 20
    assert max(counts) <= budget
    assert 0.9 * budget <= len(fitted) <= counts[-1]  # this light needs more; a few are hardly seen in the end
    assert len(fit(Schedule(budget, 0), samples=samples)) <= budget


@pytest.mark.parametrize("iterations", [1, 2, 3, 5])
def test_short_courses(iterations):
    fitted = fit(Schedule(50, iterations), samples=noisy(2000))
    assert 0.9 * fitting.START_SHARE * 50 <= len(fitted) <= 50


def test_a_hole_that_opens_after_the_growth_is_filled(monkeypatch):
    stepped = fitting._stepped

    def losing_a_wall(state, optimiser, falling, iteration, monitor):
        kept = state.keep(axes(state.gaussians.rotation)[:, 0, 2] < 0.5) if iteration == 40 else state
        return stepped(kept, optimiser, falling, iteration, monitor)

    whole = relative_error(fit(Schedule(120, 60)))
    monkeypatch.setattr(fitting, "_stepped", losing_a_wall)
    assert relative_error(fit(Schedule(120, 60))) < 2 * whole
    monkeypatch.setattr(fitting, "GROWTH", {share: grown for share, grown in fitting.GROWTH.items() if share <= 0.5})
    assert relative_error(fit(Schedule(120, 60))) > 5 * whole


def test_black_light_stays_black():
    points = corner(3000)
    fitted = fit(Schedule(60, 30), samples=samples_of(np.zeros((3000, 3)), *points))
    assert 0 < len(fitted) <= 60
    assert fitted.sh.max() == 0


def test_few_samples_and_none():
    """Also several at one place: no distance to the next says how large a Gaussian is."""
    assert len(fit(Schedule(60, 20), samples=noisy(0))) == 0
    for samples in (noisy(1), noisy(3), noisy(50)[np.repeat(np.arange(5), 4)]):
        fitted = fit(Schedule(60, 20), samples=samples)
        assert all(np.isfinite(getattr(fitted, name)).all() for name in FIELDS)
        assert (fitted.scale > 0).all()


def test_watch_sees_each_step_its_loss_and_what_it_led_to():
    seen = []
    fitted = fit(Schedule(60, 20), lambda *args: seen.append(args), samples=noisy(4000))
    assert [iteration for iteration, _, _ in seen] == [*range(1, 21)]
    assert seen[-1][1] < seen[0][1]
    last = codec.stored_shapes(seen[-1][2]())
    for name in ("position", "rotation", "scale", "opacity"):  # colours are solved once more
        np.testing.assert_array_equal(getattr(last, name), getattr(fitted, name))
    assert (seen[0][2]().position != seen[1][2]().position).any()


def test_files_have_the_shapes_for_which_the_light_was_solved():
    fitted = fit(Schedule(60, 20), samples=noisy(4000))
    read = codec.decode(codec.encode(Bake(fitted, BLEND, coarse=NOBODY))).gaussians
    order, expected = (np.lexsort(each.position.T) for each in (read, fitted))
    for name in ("position", "rotation", "scale", "opacity"):
        np.testing.assert_array_equal(getattr(read, name)[order], getattr(fitted, name)[expected], err_msg=name)


def test_the_same_seed_gives_the_same_bits_on_one_and_two_threads():
    samples, results = noisy(8000), []
    try:
        for threads in (1, 2):
            set_thread_count(threads)
            results.append(fit(Schedule(150, 30, seed=4), samples=samples))
    finally:
        set_thread_count(0)
    assert_same(*results)
    other = fit(Schedule(150, 30, seed=5), samples=samples)
    assert len(other) != len(results[0]) or (other.position != results[0].position).any()


ITERATIONS = 60
COURSE = Schedule(80, ITERATIONS, seed=5)


@pytest.fixture(scope="module")
def undisturbed() -> tuple[Gaussians, list]:
    """The result, and what `watch` was told."""
    told = []
    return fit(COURSE, lambda *args: told.append(heard(*args)), samples=noisy(3000)), told


def heard(iteration: int, loss: float, now) -> tuple:
    return iteration, loss, len(now())


KEY = task_key("checkpoint", number=1)


class Killed(BaseException):
    """Ends a fit as a signal would."""


@pytest.fixture
def always_due(monkeypatch):
    """A state is kept whenever that is possible."""
    monkeypatch.setattr(checkpoint_module, "INTERVAL", 0.0)
    monkeypatch.setattr(checkpoint_module, "SHARE", 1e9)


def run_until(stop: int, folder) -> None:
    def watch(iteration, *_):
        if iteration == stop:
            raise Killed

    with pytest.raises(Killed):
        fit(COURSE, watch, Checkpoint(Cache(folder), KEY), samples=noisy(3000))


# Changes of the number come after 12, 21, 30 and 45 steps, so one with a fresh state, the others between two states.
@pytest.mark.parametrize("stop", [1, 10, 11, 12, 13, 20, 21, 22, 29, 30, 31, 32, 41, 45, 46, 59, 60])
def test_an_interrupted_fit_ends_in_the_same_bits(tmp_path, always_due, undisturbed, stop):
    expected, told = undisturbed
    assert len({count for _, _, count in told}) > 2
    run_until(stop, tmp_path)
    assert len(entries(tmp_path)) == (stop > 10)
    again = []
    watch = lambda *args: again.append(heard(*args))  # noqa: E731
    assert_same(fit(COURSE, watch, Checkpoint(Cache(tmp_path), KEY), samples=noisy(3000)), expected)
    assert again == told[(stop - 1) // 10 * 10 :]


def test_a_finished_state_is_the_result(tmp_path, always_due, undisturbed):
    fit(COURSE, checkpoint=Checkpoint(Cache(tmp_path), KEY), samples=noisy(3000))
    again = []
    result = fit(COURSE, lambda *args: again.append(args), Checkpoint(Cache(tmp_path), KEY), samples=noisy(3000))
    assert not again
    assert_same(result, undisturbed[0])


def test_what_is_not_finite_is_named_with_its_iteration():
    broken = noisy(2000)
    broken.indirect_a[7] = np.nan
    with pytest.raises(FloatingPointError, match=r"gradient of Gaussian \d+ is not finite at iteration 0"):
        fit(Schedule(50, 20), samples=broken)


def test_the_start_lies_flat_on_the_surfaces_with_the_light_there():
    samples = noisy(5000, noise=0.0)
    first = fitting.start(samples, 100, np.random.default_rng(0))
    assert 80 < len(first) <= 100
    normal = axes(first.rotation)[:, :, 2]
    wall = normal.argmax(axis=1)
    np.testing.assert_allclose(normal, np.eye(3)[wall], atol=1e-6)
    np.testing.assert_array_equal(first.position[np.arange(len(first)), wall], 0)
    assert (first.scale[:, 2] < first.scale[:, :2].min(axis=1)).all()
    np.testing.assert_allclose(first.sh[:, 0] / np.sqrt(4 * np.pi), field(first.position, normal), rtol=1e-5)


def test_the_start_leaves_free_space_to_the_coarse_level():
    """From 1.6 times as far from the walls as Gaussians are from each other."""
    first = fitting.start(noisy(5000, noise=0.0), 100, np.random.default_rng(0))
    position, normal = corner(2000, seed=3)
    apart = np.median(spacing(first.position))
    alone = np.sort(position, axis=1)[:, 1] > 2 * apart  # with no other wall near
    on_walls, before = (
        look_up(first, NOBODY, BLEND, (position + distance * normal)[alone], normal[alone])[1]
        for distance in (0, np.float32(1.6 * apart))
    )
    assert (on_walls > BLEND.floor).mean() > 0.97
    assert (before < BLEND.floor).all()


def floor_of(samples: SurfaceSamples) -> SurfaceSamples:
    return samples[samples.normal[:, 1] > 0]


def test_samples_that_none_covers_get_gaussians():
    samples = noisy()
    alone = fitting.start(floor_of(samples), 100, np.random.default_rng(0))
    optimiser = SurfaceOptimiser(samples, NOBODY, BLEND)
    added = fitting.where_wrong(optimiser.solve(alone), 60, optimiser, samples, np.random.default_rng(1))
    assert 30 < len(added) <= 60
    assert (axes(added.rotation)[:, 1, 2] < 0.5).mean() > 0.9  # hardly any on the floor
    for room in (0, -3):
        assert len(fitting.where_wrong(alone, room, optimiser, samples, np.random.default_rng(1))) == 0


def board() -> SurfaceSamples:
    """A floor of 2 x 2 m in light of 1, and 0.3 m above it a board of 0.2 x 0.2 m in light of 4."""
    rng = np.random.default_rng(0)
    floor, top = rng.uniform(0, 2, (20_000, 3)), rng.uniform(0.9, 1.1, (300, 3))
    floor[:, 1], top[:, 1] = 0, 0.3
    position = np.concatenate([floor, top]).astype(np.float32)
    light = np.repeat([1.0, 4.0], [len(floor), len(top)])[:, None] * np.ones(3)
    return samples_of(light, position, np.tile(np.float32([0, 1, 0]), (len(position), 1)), 0.1)


def test_small_things_that_the_start_missed_get_gaussians_that_lie_on_them():
    """The halves of those that read the board from the floor would lie on the floor."""
    samples = board()
    alone = fitting.start(samples[:20_000], 30, np.random.default_rng(0))
    optimiser = SurfaceOptimiser(samples, NOBODY, BLEND)
    added = fitting.where_wrong(optimiser.solve(alone), 20, optimiser, samples, np.random.default_rng(1))
    on_board = added.position[:, 1] > 0.25
    assert on_board.sum() >= 8
    assert added.scale[on_board].max() < 0.2  # m: as small as the board


def test_after_an_edit_light_follows_normal_maps_where_there_are_any_now():
    """Of light that leans to +x and samples that were flat before, and the other way round."""
    points, rng = corner(4000), np.random.default_rng(1)
    flat = samples_of(field(*points), *points)
    lean = np.where(rng.random((4000, 1)) < 0.5, np.float32([0.4, 0, 0]), 0).astype(np.float32)
    mapped = (points[1] + lean) / np.linalg.norm(points[1] + lean, axis=1, keepdims=True)
    light = flat.indirect * (1 + mapped[:, :1] - points[1][:, :1])
    bent = replace(samples_of(light, *points), mapped=mapped.astype(np.float32))
    course = Schedule(40, 20)
    before = {False: fit(course, samples=flat), True: fit(course, samples=bent)}
    for now in (flat, bent):
        after = fit_again(now, now[:0], NOBODY, BLEND, course, before[not now.bumpy])
        assert after.bumpy == now.bumpy
    assert np.abs(after.relief).max() > 0.1
