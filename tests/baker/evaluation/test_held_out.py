"""The evaluation: each view at its own exposure, honest means, and the same loss as the fit asks for on its way."""

from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.comparison import indirect_ceiling
from gsgi.baker.evaluation.held_out import CEILING_MIN, HeldOutLoss, evaluate, exposure, noisy
from gsgi.baker.evaluation.metrics import ssim
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.visible import Surface
from gsgi.runtime import constants
from gsgi.runtime.camera import look_at
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend
from gsgi.runtime.scene import Scene

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


def dimmed(reference: Reference, factor: float) -> Reference:
    """The same with `factor` times the light."""
    names = "primary", "indirect_a", "indirect_b"
    return replace(reference, **{name: np.float32(factor) * getattr(reference, name) for name in names})


def test_a_dark_view_is_judged_as_an_eye_there_sees_it(baked, truths):
    """A view with a hundredth of the light counts like a bright one, and changes no other view."""
    bright = evaluate({"front": truths["front"]}, CAMERAS, scaled(baked, 1.2)).views[0]
    dark = dimmed(truths["front"], 0.01)
    alone = evaluate({"front": dark}, CAMERAS, scaled(baked, 0.012)).views[0]
    assert alone.indirect.ssim == pytest.approx(bright.indirect.ssim, abs=1e-4)
    assert alone.indirect.psnr == pytest.approx(bright.indirect.psnr, abs=0.01)
    assert alone.final.ssim == pytest.approx(bright.final.ssim, abs=1e-4)
    assert alone.mottle == pytest.approx(bright.mottle, rel=1e-3)
    beside = evaluate({"dark": dark, "back": truths["back"]}, CAMERAS | {"dark": CAMERAS["front"]}, baked)
    without = evaluate({"back": truths["back"]}, CAMERAS, baked)
    assert beside.views[1] == without.views[0]
    assert beside.worst.name == "dark"


def test_black_is_seen_by_an_eye_used_to_the_scene(truths):
    black = np.zeros((SIZE, SIZE, 3), np.float32)
    assert exposure(black, 0.5) == pytest.approx(constants.MID_GREY / 0.5)
    light = truths["front"].indirect
    assert exposure(light, 0.5) == auto_exposure(light)


def noise(strength: float) -> Reference:
    """Grey of 1 with noise."""
    return reference_of(np.ones((SIZE, SIZE, 3), np.float32), noise=strength)


def test_a_view_too_noisy_to_tell_anything_is_left_out(baked, truths, monkeypatch):
    monkeypatch.setattr("gsgi.baker.trace.denoise.available", lambda: False)
    clear, vague = noise(0.001), noise(0.5)
    assert indirect_ceiling(vague) < CEILING_MIN < indirect_ceiling(clear)
    assert (noisy(clear), noisy(vague)) == (False, True)
    cameras = CAMERAS | {"vague": CAMERAS["front"]}
    both = evaluate(truths | {"vague": vague}, cameras, baked, {"vague": vague})
    alone = evaluate(truths, cameras, baked)
    assert [view.noisy for view in (*both.views, *both.scene_views)] == [False, False, True, True]
    assert (both.mean.indirect, both.mean.final, both.mean.mottle) == (
        alone.mean.indirect, alone.mean.final, alone.mean.mottle,
    )  # fmt: skip
    assert both.mean.name == "mean of 2 views"
    assert both.worst == alone.worst
    loss, psnr = HeldOutLoss(truths | {"vague": vague}, cameras, 0.5).of(baked)
    assert loss == pytest.approx(both.mean.loss, rel=1e-6)
    assert psnr == pytest.approx(both.mean.indirect.psnr, abs=1e-4)
    hopeless = evaluate({"vague": vague}, cameras, baked)
    assert (hopeless.mean, hopeless.worst, len(hopeless.views)) == (None, None, 1)


def test_stray_paths_in_a_black_room_are_noise_and_black_is_not():
    black = reference_of(np.zeros((SIZE, SIZE, 3), np.float32), noise=0)
    rng = np.random.default_rng(0)
    strays = [np.where(rng.uniform(size=(SIZE, SIZE, 1)) < 0.01, np.float32(0.1), 0) for _ in range(2)]
    halves = [np.where(black.valid[..., None], stray, 0) * np.ones(3, np.float32) for stray in strays]
    assert not noisy(black)
    assert noisy(replace(black, indirect_a=halves[0], indirect_b=halves[1]))


def test_a_level_of_noise_that_hides_what_one_sees(monkeypatch):
    """Where the ceiling is CEILING_MIN, the truth itself has about SSIM_GOOD."""
    monkeypatch.setattr("gsgi.baker.trace.denoise.available", lambda: False)
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.3, 0.7, (256, 256, 3))
    for strength in np.geomspace(0.01, 0.2, 12):
        a, b = (truth + strength * rng.normal(size=truth.shape) for _ in range(2))
        if ssim(a, b) < CEILING_MIN:
            break
        told = ssim((a + b) / 2, truth)
        assert told > held_out.SSIM_GOOD - 0.002
    assert ssim((a + b) / 2, truth) < held_out.SSIM_GOOD


def test_the_cameras_of_the_scene_are_reported_beside_the_mean(baked, truths):
    """They were fitted, so they are not in the mean, but they may be the worst."""
    front, back = ({name: truths[name]} for name in ("front", "back"))
    worse = dimmed(truths["back"], 0.5)
    evaluation = evaluate(front, CAMERAS, baked, {"back": worse})
    assert [(view.name, view.of_scene) for view in evaluation.views] == [("front", False)]
    assert [(view.name, view.of_scene) for view in evaluation.scene_views] == [("back", True)]
    assert evaluation.mean.indirect == evaluation.views[0].indirect
    assert evaluation.worst == evaluation.scene_views[0]
    assert evaluate(front, CAMERAS, baked, back).worst.final.ssim <= evaluation.mean.final.ssim


def test_in_a_sector_only_its_own_light_is_compared(truths):
    truth, box = truths["front"], np.array([[-9.0, -9, -9], [0, 9, 9]])
    within = held_out._within(box, truth)
    left = truth.surface.position[..., 0] <= 0
    np.testing.assert_array_equal(within.valid, truth.valid & left)
    assert within.valid.any()
    assert not within.indirect[~left].any()
    np.testing.assert_array_equal(within.indirect[left], truth.indirect[left])
    assert held_out._within(None, truth) is truth


def test_the_first_cameras_of_a_scene_are_traced(truths):
    seeds = []

    def reference(camera, size, samples, seed, advance, known) -> Reference:
        seeds.append(seed)
        return truths["front"]

    own = {f"camera {i}": CAMERAS["front"] for i in range(held_out.SCENE_VIEWS + 2)}
    plan = SimpleNamespace(
        tracer=SimpleNamespace(reference=reference),
        placement=SimpleNamespace(held_out=CAMERAS),
        scene=Scene((), (), cameras=own),
        settings=SimpleNamespace(seed=0),
        triangles=SimpleNamespace(box=None),
        known_paths=0,
    )
    assert list(held_out.scene_references(plan, None, print)) == list(own)[: held_out.SCENE_VIEWS]
    held_out.references(plan, None, print)
    assert len(set(seeds)) == len(seeds) == held_out.SCENE_VIEWS + len(CAMERAS)
    assert held_out.points(plan) == 2 * len(seeds) * held_out.SIZE**2


def test_views_without_a_b_are_no_part_of_the_evaluation(truths):
    blind = replace(truths["back"], valid=np.zeros((SIZE, SIZE), bool))
    found = iter([truths["front"], blind])
    light = SimpleNamespace(reference=lambda *_: next(found))
    placement, settings = SimpleNamespace(held_out=CAMERAS), SimpleNamespace(seed=0)
    scene = Scene((), ())
    made = {"triangles": SimpleNamespace(box=None), "known_paths": 0}
    plan = SimpleNamespace(tracer=light, placement=placement, settings=settings, scene=scene, **made)
    assert list(held_out.references(plan, None, print)) == ["front"]


def test_no_view_is_no_failure(baked):
    evaluation = evaluate({}, CAMERAS, baked)
    assert evaluation == held_out.Evaluation([], None, [], None)
    assert HeldOutLoss({}, CAMERAS, 0.5).of(baked) == (0.0, 100.0)
