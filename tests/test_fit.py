"""The fit: it finds light that is known, repeats itself exactly, and survives odd input."""

import numpy as np
import pytest
import scenes
import torch

from gsgi.baker.fit import View, fit
from gsgi.baker.initialise import from_surface
from gsgi.baker.loss import Loss, image_loss
from gsgi.baker.splat import rasterise, set_thread_count
from gsgi.baker.surface_points import Triangles
from gsgi.baker.target import Target
from gsgi.baker.views import place
from gsgi.runtime.gaussians import Blend, Gaussians

BLEND = Blend(near=0.01)
SIZE = 48


@pytest.fixture(scope="module")
def room() -> Triangles:
    return Triangles(scenes.furnace())


@pytest.fixture(scope="module")
def start(room) -> Gaussians:
    points = room.sample(300, seed=0)
    return from_surface(points, np.full((300, 3), 0.5, np.float32), sh_degree=0)


@pytest.fixture(scope="module")
def views(room, start) -> list[View]:
    """Images of Gaussians that differ from the start in everything."""
    rng = np.random.default_rng(4)
    truth = Gaussians(
        start.position + rng.normal(0, 0.02, start.position.shape).astype(np.float32),
        start.rotation,
        (start.scale * rng.uniform(0.8, 1.4, start.scale.shape)).astype(np.float32),
        np.full(len(start), 0.9, np.float32),
        (start.sh * rng.uniform(0.3, 2.0, (len(start), 1, 3))).astype(np.float32),
    )
    everywhere = np.ones((SIZE, SIZE), bool)
    cameras = place(room, {}, SIZE, seed=3, count=32).fitted.values()
    return [View(c, rasterise(truth, c.pinhole(SIZE, SIZE), BLEND), everywhere) for c in cameras]


def mean_loss(gaussians: Gaussians, views: list[View]) -> float:
    losses = []
    for view in views:
        image = rasterise(gaussians, view.camera.pinhole(SIZE, SIZE), BLEND)
        losses.append(image_loss(image, Target.of(view.indirect, view.valid, 0.5)).value)
    return sum(losses) / len(losses)


def test_the_fit_finds_the_light_of_known_gaussians(start, views):
    fitted = fit(start, views[:24], BLEND, tone_scale=0.5, iterations=600, seed=0)
    before, after = (mean_loss(g, views[:24]) for g in (start, fitted))
    assert after < before / 4
    # Which Gaussian lies over which is not wholly fixed by 24 small images: views that were not fitted gain less.
    before, after = (mean_loss(g, views[24:]) for g in (start, fitted))
    assert after < 0.7 * before
    norms = np.linalg.norm(fitted.rotation, axis=1)
    np.testing.assert_allclose(norms, 1, rtol=1e-5)


def test_the_same_seed_gives_the_same_bits_on_one_and_two_threads(start, views):
    first = fit(start, views, BLEND, 0.5, iterations=20, seed=1)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    set_thread_count(1)
    try:
        second = fit(start, views, BLEND, 0.5, iterations=20, seed=1)
    finally:
        torch.set_num_threads(threads)
        set_thread_count(0)
    for name in ("position", "rotation", "scale", "opacity", "sh"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_no_iterations_return_the_start(start, views):
    same = fit(start, views, BLEND, 0.5, iterations=0, seed=0)
    np.testing.assert_allclose(same.opacity, start.opacity, rtol=1e-5)
    np.testing.assert_array_equal(same.position, start.position)


def test_what_is_masked_out_leaves_the_gaussians_alone(start, views):
    nothing = [View(v.camera, v.indirect, np.zeros((SIZE, SIZE), bool)) for v in views]
    same = fit(start, nothing, BLEND, 0.5, iterations=5, seed=0)
    np.testing.assert_array_equal(same.position, start.position)


@pytest.mark.parametrize("count", [0, 1])
def test_almost_no_gaussians_still_fit(start, views, count):
    few = Gaussians(
        start.position[:count], start.rotation[:count], start.scale[:count], start.opacity[:count], start.sh[:count]
    )
    assert len(fit(few, views, BLEND, 0.5, iterations=3, seed=0)) == count


def test_black_is_data(start, views):
    dark = [View(v.camera, np.zeros_like(v.indirect), v.valid) for v in views]
    fitted = fit(start, dark, BLEND, 0.5, iterations=300, seed=0)
    image = rasterise(fitted, views[0].camera.pinhole(SIZE, SIZE), BLEND)
    assert image.mean() < 0.1 * rasterise(start, views[0].camera.pinhole(SIZE, SIZE), BLEND).mean()


def test_a_loss_that_is_not_finite_stops_with_iteration_and_view(start, views, monkeypatch):
    monkeypatch.setattr("gsgi.baker.fit.image_loss", lambda image, target: Loss(np.nan, image, image[..., 0]))
    with pytest.raises(FloatingPointError, match="iteration 0, view 0"):
        fit(start, views[:1], BLEND, 0.5, iterations=3, seed=0)


def test_a_view_that_is_not_finite_is_refused(start, views):
    broken = [View(views[0].camera, np.full_like(views[0].indirect, np.nan), views[0].valid)]
    with pytest.raises(ValueError, match="not finite"):
        fit(start, broken, BLEND, 0.5, iterations=3, seed=0)
