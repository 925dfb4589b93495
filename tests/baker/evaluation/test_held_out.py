"""The evaluation: one exposure for all views, honest means, and the same loss as the fit asks for on its way."""

from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.comparison import compare_indirect
from gsgi.baker.evaluation.held_out import HeldOutLoss, evaluate, exposure
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import Surface
from gsgi.runtime.camera import look_at
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend

SIZE = 40
UP = np.array([0.0, 1.0, 0.0])
CAMERAS = {
    "front": scenes.inside_camera(),
    "back": look_at(np.array([0.1, 0.0, -0.6]), np.array([0.0, 0.1, 1.0]), UP, 1.0, 0.01),
}


@pytest.fixture(scope="module", params=[OverBlend(near=0.01), SurfaceBlend()], ids=["over", "surface"])
def blend(request) -> OverBlend | SurfaceBlend:
    return request.param


@pytest.fixture(scope="module")
def gaussians() -> Gaussians:
    """Light of different brightness on the walls of a box of edge 2."""
    rng = np.random.default_rng(0)
    position = rng.uniform(-1, 1, (600, 3))
    position[np.arange(600), rng.integers(0, 3, 600)] = rng.choice([-1.0, 1.0], 600)
    rotation = np.tile(np.float32([0, 0, 0, 1]), (600, 1))
    sh = rng.uniform(0.5, 3, (600, 1, 3)).astype(np.float32)
    arrays = rotation, np.full((600, 3), 0.15, np.float32), np.full(600, 0.9, np.float32), sh
    return Gaussians(position.astype(np.float32), *arrays)


@pytest.fixture(scope="module")
def baked(gaussians, blend) -> Bake:
    """The surface operator has one large coarse Gaussian besides."""
    if isinstance(blend, OverBlend):
        return Bake(gaussians, blend, tone_scale=0.5)
    arrays = np.float32([[0, 0, 0, 1]]), np.full((1, 3), 2, np.float32), np.ones(1, np.float32)
    coarse = Gaussians(np.zeros((1, 3), np.float32), *arrays, np.full((1, 1, 3), 1.5, np.float32))
    return Bake(gaussians, blend, tone_scale=0.5, coarse=coarse)


def scaled(baked: Bake, factor: float) -> Bake:
    """The same with `factor` times the light."""
    levels = {"gaussians": baked.gaussians, "coarse": baked.coarse}
    brighter = {name: level and replace(level, sh=level.sh * np.float32(factor)) for name, level in levels.items()}
    return replace(baked, **brighter)


def reference_of(indirect: np.ndarray, noise: float = 1e-3, seed: int = 0, z: float = -1.0) -> Reference:
    """A wall of the box at `z`. Half of the image is diffuse; the two halves of the samples differ by noise."""
    diffuse = np.zeros(indirect.shape[:2], bool)
    diffuse[:, : SIZE // 2 + 8] = True
    rng = np.random.default_rng(seed)
    a, b = (np.float32(noise) * rng.normal(size=indirect.shape).astype(np.float32) for _ in range(2))
    empty = np.zeros_like(indirect)
    albedo = np.where(diffuse[..., None], np.float32(0.5), 0)
    y, x = np.mgrid[1 : -1 : SIZE * 1j, -1 : 1 : SIZE * 1j]
    position = np.stack([x, y, np.full_like(x, z)], axis=2).astype(np.float32)
    inward = np.tile(np.float32([0, 0, -np.sign(z)]), (*diffuse.shape, 1))
    surface = Surface(position, inward, inward, inward, albedo, empty, empty[..., 0], np.ones_like(diffuse), diffuse)
    primary = np.full_like(indirect, 0.2)
    halves = (np.where(diffuse[..., None], np.maximum(indirect + half, 0), 0) for half in (a, b))
    return Reference(surface, primary, *halves, diffuse)


@pytest.fixture(scope="module")
def truths(baked) -> dict[str, Reference]:
    """What the bake shows, and noise."""
    found = {}
    for seed, ((name, camera), z) in enumerate(zip(CAMERAS.items(), (-1.0, 1.0), strict=True)):
        black = reference_of(np.zeros((SIZE, SIZE, 3), np.float32), z=z)
        found[name] = reference_of(held_out.draw(baked, camera, black), seed=seed, z=z)
    return found


def test_a_bake_is_drawn_where_the_reference_was_traced(baked, truths):
    image = held_out.draw(baked, CAMERAS["front"], truths["front"])
    assert (image.shape, image.dtype) == ((SIZE, SIZE, 3), np.float32)
    valid = truths["front"].valid
    np.testing.assert_allclose(image[valid], truths["front"].indirect[valid], atol=5e-3)  # five times its noise
    assert image[valid].max() > 0.5
    if baked.coarse:
        assert not image[~valid].any()


def test_the_loss_on_the_way_is_that_of_the_evaluation(baked, truths):
    worse = scaled(baked, 1.2)
    evaluation = evaluate(truths, CAMERAS, worse)
    loss, psnr = HeldOutLoss(truths, CAMERAS, 0.5).of(worse)
    assert loss == pytest.approx(evaluation.mean.loss, rel=1e-6)
    assert psnr == pytest.approx(evaluation.mean.indirect.psnr, abs=1e-4)
    better = evaluate(truths, CAMERAS, baked).mean
    assert better.loss < evaluation.mean.loss / 2
    assert better.indirect.psnr > psnr + 10
    assert better.final.psnr > evaluation.mean.final.psnr + 10


def test_the_mean_is_of_what_the_views_add_up_to(baked, truths):
    evaluation = evaluate(truths, CAMERAS, scaled(baked, 1.2))
    assert [view.name for view in evaluation.views] == list(CAMERAS)
    assert evaluation.mean.name == "mean of 2 views"
    assert evaluation.mean.loss == pytest.approx(np.mean([view.loss for view in evaluation.views]))
    for layer in ("indirect", "final"):
        mean, scores = getattr(evaluation.mean, layer), [getattr(view, layer) for view in evaluation.views]
        assert 10 ** (-mean.psnr / 10) == pytest.approx(np.mean([10 ** (-s.psnr / 10) for s in scores]))
        for name in ("ssim", "ssim_ceiling", "flip"):
            assert getattr(mean, name) == pytest.approx(np.mean([getattr(score, name) for score in scores]))


def test_only_pixels_with_a_b_count(baked, truths):
    """The Gaussians may hold any light where nobody sees it."""
    lights = HeldOutLoss(deepcopy(truths), CAMERAS, 0.5)
    before = lights.of(baked)
    for truth in lights.references:
        truth.indirect_a[~truth.valid] += 9
    assert lights.of(baked) == before
    for truth in lights.references:
        truth.indirect_a[truth.valid] += 9
    assert lights.of(baked) != before


def test_a_dark_view_is_judged_as_dark_as_it_looks(baked, truths):
    """An error of 1e-4 of the light next door is not seen, whatever it is to the dark itself."""
    rng = np.random.default_rng(1)
    dark = reference_of(np.float32(1e-5) * rng.uniform(size=(SIZE, SIZE, 3)).astype(np.float32), noise=1e-6)
    nearly_dark = np.full((SIZE, SIZE, 3), 1e-4, np.float32)
    one = exposure([dark.indirect, *(truth.indirect for truth in truths.values())])
    own, honest = compare_indirect(nearly_dark, dark), compare_indirect(nearly_dark, dark, one)
    assert own.psnr < 5
    assert own.ssim < 0.8
    assert honest.psnr > 60
    assert honest.ssim > 0.99
    evaluation = evaluate(truths | {"dark": dark}, CAMERAS | {"dark": CAMERAS["front"]}, baked)
    alone = evaluate(truths, CAMERAS, baked)
    # One dark view of three makes the others look brighter by a fourth of a stop.
    for with_dark, without in zip(evaluation.views, alone.views, strict=False):
        assert with_dark.indirect.psnr == pytest.approx(without.indirect.psnr - 10 * np.log10(1.5), abs=0.1)
        assert with_dark.loss == without.loss


def test_one_exposure_for_a_scene():
    image = np.random.default_rng(0).gamma(2, 0.3, (16, 16, 3)).astype(np.float32)
    black = np.zeros_like(image)
    assert exposure([image]) == pytest.approx(auto_exposure(image))
    assert exposure([image] * 3) == pytest.approx(auto_exposure(image))
    assert exposure([image, 10 * image]) == pytest.approx(auto_exposure(image) / np.sqrt(50.5))
    assert exposure([image, black]) == pytest.approx(exposure([image, image * 1e-4]), rel=1e-6)
    assert exposure([]) == exposure([black, black]) == 1


def test_views_without_a_b_are_no_part_of_the_evaluation(truths):
    blind = replace(truths["back"], valid=np.zeros((SIZE, SIZE), bool))
    found = iter([truths["front"], blind])
    light = SimpleNamespace(reference=lambda camera, size, samples, seed, advance: next(found))
    plan = SimpleNamespace(tracer=light, placement=SimpleNamespace(held_out=CAMERAS), settings=SimpleNamespace(seed=0))
    assert list(held_out.references(plan, print)) == ["front"]
    assert held_out.points(plan) == 2 * 2 * held_out.SIZE**2


def test_no_view_is_no_failure(baked):
    evaluation = evaluate({}, CAMERAS, baked)
    assert (evaluation.views, evaluation.mean) == ([], None)
    assert HeldOutLoss({}, CAMERAS, 0.5).of(baked) == (0.0, 100.0)
