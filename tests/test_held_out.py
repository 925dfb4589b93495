"""The exam: one exposure for all views, honest means, and the same loss as the fit asks for on its way."""

from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker import held_out
from gsgi.baker.held_out import HeldOutLoss, exposure, judge
from gsgi.baker.irradiance import Surface
from gsgi.baker.rasterise import rasterise
from gsgi.baker.reference import Reference, judge_indirect
from gsgi.runtime.camera import look_at
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend

SIZE = 40
BLEND = OverBlend(near=0.01)
UP = np.array([0.0, 1.0, 0.0])
CAMERAS = {
    "front": scenes.inside_camera(),
    "back": look_at(np.array([0.1, 0.0, -0.6]), np.array([0.0, 0.1, 1.0]), UP, 1.0, 0.01),
}


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


def scaled(gaussians: Gaussians, factor: float) -> Gaussians:
    return replace(gaussians, sh=gaussians.sh * np.float32(factor))


def baked(gaussians: Gaussians) -> Bake:
    return Bake(gaussians, BLEND, tone_scale=0.5)


def reference_of(indirect: np.ndarray, noise: float = 1e-3, seed: int = 0) -> Reference:
    """Half of the image is diffuse; the two halves of the samples differ by noise."""
    diffuse = np.zeros(indirect.shape[:2], bool)
    diffuse[:, : SIZE // 2 + 8] = True
    rng = np.random.default_rng(seed)
    a, b = (np.float32(noise) * rng.normal(size=indirect.shape).astype(np.float32) for _ in range(2))
    empty = np.zeros_like(indirect)
    albedo = np.where(diffuse[..., None], np.float32(0.5), 0)
    up = np.tile(np.float32([0, 1, 0]), (*diffuse.shape, 1))
    surface = Surface(empty, up, up, up, albedo, empty, empty[..., 0], np.ones_like(diffuse), diffuse)
    primary = np.full_like(indirect, 0.2)
    halves = (np.where(diffuse[..., None], np.maximum(indirect + half, 0), 0) for half in (a, b))
    return Reference(surface, primary, *halves, diffuse)


@pytest.fixture(scope="module")
def truths(gaussians) -> dict[str, Reference]:
    images = (rasterise(gaussians, camera.pinhole(SIZE, SIZE), BLEND) for camera in CAMERAS.values())
    return {name: reference_of(image, seed=k) for k, (name, image) in enumerate(zip(CAMERAS, images, strict=True))}


def test_the_loss_on_the_way_is_that_of_the_exam(gaussians, truths):
    worse = scaled(gaussians, 1.2)
    exam = judge(truths, CAMERAS, baked(worse))
    loss, psnr = HeldOutLoss(truths, CAMERAS, 0.5).of(worse, BLEND)
    assert loss == pytest.approx(exam.mean.loss, rel=1e-6)
    assert psnr == pytest.approx(exam.mean.indirect.psnr, abs=1e-4)
    better = judge(truths, CAMERAS, baked(gaussians)).mean
    assert better.loss < exam.mean.loss / 2
    assert better.indirect.psnr > psnr + 10
    assert better.final.psnr > exam.mean.final.psnr + 10


def test_the_mean_is_of_what_the_views_add_up_to(gaussians, truths):
    exam = judge(truths, CAMERAS, baked(scaled(gaussians, 1.2)))
    assert [view.name for view in exam.views] == list(CAMERAS)
    assert exam.mean.name == "mean of 2 views"
    assert exam.mean.loss == pytest.approx(np.mean([view.loss for view in exam.views]))
    for layer in ("indirect", "final"):
        mean, scores = getattr(exam.mean, layer), [getattr(view, layer) for view in exam.views]
        assert 10 ** (-mean.psnr / 10) == pytest.approx(np.mean([10 ** (-s.psnr / 10) for s in scores]))
        for name in ("ssim", "ssim_ceiling", "flip"):
            assert getattr(mean, name) == pytest.approx(np.mean([getattr(score, name) for score in scores]))


def test_only_pixels_with_a_b_count(gaussians, truths):
    """The Gaussians may hold any light where nobody sees it."""
    lights = HeldOutLoss(deepcopy(truths), CAMERAS, 0.5)
    before = lights.of(gaussians, BLEND)
    for truth in lights.references:
        truth.indirect_a[~truth.valid] += 9
    assert lights.of(gaussians, BLEND) == before
    for truth in lights.references:
        truth.indirect_a[truth.valid] += 9
    assert lights.of(gaussians, BLEND) != before


def test_a_dark_view_is_judged_as_dark_as_it_looks(gaussians, truths):
    """An error of 1e-4 of the light next door is not seen, whatever it is to the dark itself."""
    rng = np.random.default_rng(1)
    dark = reference_of(np.float32(1e-5) * rng.uniform(size=(SIZE, SIZE, 3)).astype(np.float32), noise=1e-6)
    nearly_dark = np.full((SIZE, SIZE, 3), 1e-4, np.float32)
    one = exposure([dark.indirect, *(truth.indirect for truth in truths.values())])
    own, honest = judge_indirect(nearly_dark, dark).difference, judge_indirect(nearly_dark, dark, one).difference
    assert own.psnr < 5
    assert own.ssim < 0.8
    assert honest.psnr > 60
    assert honest.ssim > 0.99
    exam = judge(truths | {"dark": dark}, CAMERAS | {"dark": CAMERAS["front"]}, baked(gaussians))
    alone = judge(truths, CAMERAS, baked(gaussians))
    # One dark view of three makes the others look brighter by a fourth of a stop.
    for with_dark, without in zip(exam.views, alone.views, strict=False):
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


def test_views_without_a_b_are_no_part_of_the_exam(gaussians, truths):
    blind = replace(truths["back"], valid=np.zeros((SIZE, SIZE), bool))
    found = iter([truths["front"], blind])
    light = SimpleNamespace(reference=lambda camera, size, samples, seed, advance: next(found))
    plan = SimpleNamespace(light=light, placement=SimpleNamespace(held_out=CAMERAS), settings=SimpleNamespace(seed=0))
    assert list(held_out.references(plan, print)) == ["front"]
    assert held_out.points(plan) == 2 * 2 * held_out.SIZE**2


def test_no_view_is_no_failure(gaussians):
    exam = judge({}, CAMERAS, baked(gaussians))
    assert (exam.views, exam.mean) == ([], None)
    assert HeldOutLoss({}, CAMERAS, 0.5).of(gaussians, BLEND) == (0.0, 100.0)
