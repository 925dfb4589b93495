"""The fit: it finds light that is known, keeps to its budget, repeats itself exactly, and survives odd input."""

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.store import Cache, task_key
from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.over import optimiser
from gsgi.baker.over.fit import Schedule, TargetView, fit
from gsgi.baker.over.initialise import from_surface
from gsgi.baker.over.rasterise import rasterise, set_thread_count
from gsgi.baker.settings import QUALITIES
from gsgi.runtime.camera import look_at
from gsgi.runtime.gaussians import Gaussians, OverBlend

BLEND = OverBlend(near=0.01)
SIZE, TONE_SCALE = 48, 0.5
EDGE = 7  # Gaussians along the edge of a wall
COUNT = 6 * EDGE**2
FIELDS = ("position", "rotation", "scale", "opacity", "sh")


@pytest.fixture(scope="module")
def start() -> Gaussians:
    """Grey, evenly spread over the walls, in an order that has nothing to do with the place."""
    rng = np.random.default_rng(0)
    walls = scenes.box()
    corners = np.stack([wall.position for wall in walls])
    u, v = ((np.indices((EDGE, EDGE)).reshape(2, 1, -1) + rng.uniform(0.3, 0.7, (2, 6, EDGE**2))) / EDGE)[..., None]
    across, up = (corners[:, [corner]] - corners[:, [0]] for corner in (1, 3))
    position = (corners[:, [0]] + u * across + v * up).reshape(-1, 3).astype(np.float32)
    normal = np.repeat([wall.normal[0] for wall in walls], EDGE**2, axis=0)
    order = rng.permutation(COUNT)
    return from_surface(position[order], normal[order], np.full((COUNT, 3), 0.5, np.float32), sh_degree=0)


@pytest.fixture(scope="module")
def views(start) -> list[TargetView]:
    """Images of Gaussians that differ from the start in everything, from inside the room in all directions."""
    rng = np.random.default_rng(4)
    truth = Gaussians(
        start.position + rng.normal(0, 0.02, start.position.shape).astype(np.float32),
        start.rotation,
        (start.scale * rng.uniform(0.8, 1.4, start.scale.shape)).astype(np.float32),
        np.full(len(start), 0.9, np.float32),
        (start.sh * rng.uniform(0.3, 2.0, (len(start), 1, 3))).astype(np.float32),
    )
    everywhere = np.ones((SIZE, SIZE), bool)
    eyes, targets = rng.uniform(-0.5, 0.5, (32, 3)), rng.normal(size=(32, 3))
    cameras = [look_at(*pair, np.array([0.0, 1.0, 0.0]), 1.2, 0.01) for pair in zip(eyes, eyes + targets, strict=True)]
    return [TargetView(c, rasterise(truth, c.pinhole(SIZE, SIZE), BLEND), everywhere) for c in cameras]


def first_of(start: Gaussians, count: int) -> Gaussians:
    return Gaussians(*(getattr(start, name)[:count] for name in FIELDS))


def black(views: list[TargetView]) -> list[TargetView]:
    return [TargetView(v.camera, np.zeros_like(v.indirect), v.valid) for v in views]


def mean_loss(gaussians: Gaussians, views: list[TargetView]) -> float:
    losses = []
    for view in views:
        image = rasterise(gaussians, view.camera.pinhole(SIZE, SIZE), BLEND)
        losses.append(image_loss(image, Target.of(view.indirect, view.valid, TONE_SCALE)).value)
    return sum(losses) / len(losses)


def assert_same(a: Gaussians, b: Gaussians):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_the_fit_finds_the_light_of_known_gaussians(start, views):
    fitted = fit(start, views[:24], BLEND, TONE_SCALE, Schedule(COUNT, 900))
    before, after = (mean_loss(g, views[:24]) for g in (start, fitted))
    assert after < before / 4
    # Which Gaussian lies over which is not wholly fixed by 24 small images: views that were not fitted gain less.
    before, after = (mean_loss(g, views[24:]) for g in (start, fitted))
    assert after < 0.7 * before
    norms = np.linalg.norm(fitted.rotation, axis=1)
    np.testing.assert_allclose(norms, 1, rtol=1e-5)


def test_more_gaussians_come_closer(start, views):
    few = first_of(start, 40)
    losses = [mean_loss(fit(few, views, BLEND, TONE_SCALE, Schedule(budget, 400)), views) for budget in (40, 300)]
    assert losses[0] > 1.1 * losses[1]


@pytest.mark.parametrize("budget", [1, 60, 100, 400])
def test_there_are_never_more_gaussians_than_the_budget(start, views, budget):
    counts = []

    def watch(iteration, loss, gaussians):
        counts.append(len(gaussians()))

    count = min(60, budget)
    fitted = fit(first_of(start, count), views, BLEND, TONE_SCALE, Schedule(budget, 200), watch)
    assert len(counts) == 200
    assert max(counts) <= budget
    assert len(fitted) == counts[-1]
    assert counts[-1] > 0.8 * budget  # it is used: these views need more


def test_a_start_beyond_the_budget_shrinks_to_it(start, views):
    counts = []
    fit(start, views, BLEND, TONE_SCALE, Schedule(50, 200), lambda _, __, gaussians: counts.append(len(gaussians())))
    changed = next(count for count in counts if count < COUNT)
    assert changed <= 50  # at once
    assert 40 < counts[-1] <= 50


def test_a_budget_beyond_what_is_useful_is_not_used_up(start, views):
    """No image of 48 px asks for as many Gaussians as this; and black none at all."""
    assert len(fit(start, views[:4], BLEND, TONE_SCALE, Schedule(10**6, 100))) < 20_000
    assert len(fit(start, black(views[:4]), BLEND, TONE_SCALE, Schedule(10**6, 300))) < 20_000


def test_watch_sees_each_iteration_and_its_loss(start, views):
    seen = []
    fit(start, views[:1], BLEND, TONE_SCALE, Schedule(COUNT, 60), lambda *args: seen.append(args[:2]))
    assert [iteration for iteration, _ in seen] == [*range(1, 61)]
    image = rasterise(start, views[0].camera.pinhole(SIZE, SIZE), BLEND)
    expected = image_loss(image, Target.of(views[0].indirect, views[0].valid, TONE_SCALE)).value
    assert seen[0][1] == pytest.approx(expected, rel=1e-3)  # opacity and scale went through logit and logarithm
    assert seen[-1][1] < 0.75 * seen[0][1]


def test_every_view_comes_once_a_round(start, views, monkeypatch):
    compared = []
    monkeypatch.setattr(optimiser, "image_loss", lambda i, target: (compared.append(target), image_loss(i, target))[1])
    fit(start, views[:4], BLEND, TONE_SCALE, Schedule(COUNT, 14))
    targets = [id(target) for target in compared]
    rounds = [targets[i : i + 4] for i in (0, 4, 8)]
    assert all(len(set(r)) == 4 for r in rounds)
    assert len(set(map(tuple, rounds))) > 1  # shuffled
    assert len(set(targets)) == 4


def test_the_same_seed_gives_the_same_bits_on_one_and_two_threads(start, views):
    def run(seed: int) -> Gaussians:
        return fit(first_of(start, 100), views, BLEND, TONE_SCALE, Schedule(200, 100, seed))

    results = [run(1), run(1)]
    try:
        for threads in (1, 2):
            set_thread_count(threads)
            results.append(run(1))
    finally:
        set_thread_count(0)
    assert len(results[0]) > 100
    for other in results[1:]:
        assert_same(results[0], other)
    other = run(2)
    assert len(other) != len(results[0]) or (other.position != results[0].position).any()


def test_no_iterations_return_the_start(start, views):
    same = fit(start, views, BLEND, TONE_SCALE, Schedule(COUNT, 0))
    np.testing.assert_allclose(same.opacity, start.opacity, rtol=1e-5)
    np.testing.assert_array_equal(same.position, start.position)
    np.testing.assert_array_equal(same.sh, start.sh)


@pytest.mark.parametrize("iterations", [1, 2, 3, 5, 10])
def test_a_few_iterations_remove_nobody_who_was_not_looked_at(start, views, iterations):
    assert len(fit(start, views, BLEND, TONE_SCALE, Schedule(COUNT, iterations))) > 0.9 * COUNT


@pytest.mark.parametrize("quality", QUALITIES["over"])
def test_whom_one_of_many_views_sees_stays(quality):
    """Between two changes of the number there may be less than a round of the views."""
    size, count, many = 8, 20, 200
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    position = np.stack([np.sin(angle), np.zeros(count), np.cos(angle)], axis=1).astype(np.float32)
    rotation, ones = np.tile(np.float32([0, 0, 0, 1]), (count, 1)), np.ones((count, 3), np.float32)
    ring = Gaussians(position, rotation, 0.03 * ones, 0.8 * ones[:, 0], ones[:, None])
    cameras = [look_at(np.zeros(3), p, np.array([0.0, 1.0, 0.0]), 0.2, 0.01) for p in position]
    images = [rasterise(ring, camera.pinhole(size, size), BLEND) for camera in cameras]
    each = [TargetView(c, i, np.ones((size, size), bool)) for c, i in zip(cameras, images, strict=True)]
    course = Schedule(count, QUALITIES["over"][quality].visits * many)
    fitted = fit(ring, each + each[:1] * (many - count), BLEND, TONE_SCALE, course)
    # Each is where it was, less than the way to the next.
    nearest = np.linalg.norm(fitted.position[:, None] - position, axis=2).argmin(axis=0)
    assert len(np.unique(nearest)) == count


def test_what_is_masked_out_leaves_the_gaussians_alone(start, views):
    """Nothing is stepped and nothing divided. Only who is in no view at all, or twice there, may go."""
    nothing = [TargetView(v.camera, v.indirect, np.zeros((SIZE, SIZE), bool)) for v in views]
    same = fit(start, nothing, BLEND, TONE_SCALE, Schedule(2 * COUNT, 400))
    assert 0.8 * COUNT < len(same) <= COUNT
    untouched = {p.tobytes() + c.tobytes() for p, c in zip(start.position, start.sh, strict=True)}
    rows = [p.tobytes() + c.tobytes() for p, c in zip(same.position, same.sh, strict=True)]
    assert np.mean([row in untouched for row in rows]) > 0.9


def test_half_of_an_image_masked_out_is_as_if_it_were_not_there(start, views):
    half = np.ones((SIZE, SIZE), bool)
    half[:, SIZE // 2 :] = False
    fits = []
    for light in (0.0, 1e9):
        masked = [TargetView(v.camera, np.where(half[..., None], v.indirect, np.float32(light)), half) for v in views]
        fits.append(fit(start, masked, BLEND, TONE_SCALE, Schedule(COUNT, 40)))
    assert_same(*fits)


@pytest.mark.parametrize("iterations", [3, 100])
@pytest.mark.parametrize("budget", [1, 100])
@pytest.mark.parametrize("count", [0, 1])
def test_almost_no_gaussians_still_fit(start, views, count, budget, iterations):
    fitted = fit(first_of(start, count), views, BLEND, TONE_SCALE, Schedule(budget, iterations))
    assert len(fitted) <= (budget if count else 0)
    assert all(np.isfinite(getattr(fitted, name)).all() for name in FIELDS)


def test_black_is_data(start, views):
    fitted = fit(start, black(views), BLEND, TONE_SCALE, Schedule(2 * COUNT, 900))
    image = rasterise(fitted, views[0].camera.pinhole(SIZE, SIZE), BLEND)
    assert image.mean() < 0.1 * rasterise(start, views[0].camera.pinhole(SIZE, SIZE), BLEND).mean()


class Breaking:
    """The loss as it is, until its gradient is not finite, or itself."""

    def __init__(self, at: int, **broken: float):
        self.left, self.broken = at, broken

    def __call__(self, image, target):
        loss = image_loss(image, target)
        self.left -= 1
        if self.left >= 0:
            return loss
        return loss._replace(**{name: np.full_like(getattr(loss, name), value) for name, value in self.broken.items()})


def test_a_gradient_that_is_not_finite_stops_with_iteration_view_and_gaussian(start, views, monkeypatch):
    monkeypatch.setattr(optimiser, "image_loss", Breaking(7, by_image=np.nan))
    with pytest.raises(FloatingPointError, match=r"Gaussian \d+ .* iteration 7, view 0"):
        fit(start, views[:1], BLEND, TONE_SCALE, Schedule(COUNT, 100))


def test_a_loss_that_is_not_finite_stops_with_iteration_and_view(start, views, monkeypatch):
    monkeypatch.setattr(optimiser, "image_loss", Breaking(7, value=np.nan))
    with pytest.raises(FloatingPointError, match="loss is nan at iteration 7, view 0"):
        fit(start, views[:1], BLEND, TONE_SCALE, Schedule(COUNT, 100))


def test_what_stops_a_fit_leaves_its_last_state_in_the_cache(start, views, monkeypatch, tmp_path):
    monkeypatch.setattr("gsgi.baker.cache.checkpoint.INTERVAL", 0.0)
    monkeypatch.setattr("gsgi.baker.cache.checkpoint.SHARE", 1e9)
    course, key = Schedule(COUNT, 20), task_key("fit", number=1)
    expected = fit(start, views, BLEND, TONE_SCALE, course)
    with monkeypatch.context() as context:
        context.setattr(optimiser, "image_loss", Breaking(7, by_image=np.nan))
        with pytest.raises(FloatingPointError):
            fit(start, views, BLEND, TONE_SCALE, course, checkpoint=Checkpoint(Cache(tmp_path), key))
    assert int(Cache(tmp_path).get(key)["iteration"]) == 7
    again = fit(start, views, BLEND, TONE_SCALE, course, checkpoint=Checkpoint(Cache(tmp_path), key))
    assert_same(again, expected)


def test_a_view_that_is_not_finite_is_refused(start, views):
    broken = [TargetView(views[0].camera, np.full_like(views[0].indirect, np.nan), views[0].valid)]
    with pytest.raises(ValueError, match="not finite"):
        fit(start, broken, BLEND, TONE_SCALE, Schedule(COUNT, 3))


@pytest.mark.parametrize("name", FIELDS)
def test_a_start_that_is_not_finite_is_refused(start, views, name):
    """One Gaussian alone, or all others would follow it: steps are in units of the mean scale."""
    broken = Gaussians(*(getattr(start, field).copy() for field in FIELDS))
    getattr(broken, name)[3] = np.nan
    with pytest.raises((ValueError, FloatingPointError), match="not finite"):
        fit(broken, views, BLEND, TONE_SCALE, Schedule(COUNT, 20))
