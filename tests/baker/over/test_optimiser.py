"""A step of the fit on the CPU: it lowers the loss, leaves alone who is not seen, and stops at what is not finite."""

import numpy as np
import oracle
import pytest
import scenes

from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.over import optimiser as module
from gsgi.baker.over.optimiser import CpuOptimiser
from gsgi.baker.over.rasterise import rasterise
from gsgi.baker.over.raw_gaussians import NAMES, RawGaussians
from gsgi.baker.over.workspace import AdamState
from gsgi.runtime.gaussians import OverBlend

BLEND = OverBlend(near=0.01)
CAMERA = scenes.inside_camera()
PINHOLE = CAMERA.pinhole(48, 40)
TONE_SCALE = 0.5
RATES = {"position": 0.003, "rotation": 0.004, "log_scale": 0.01, "logit_opacity": 0.02, "sh": 0.02}


def random_raw(count: int = 60, degree: int = 0, seed: int = 2) -> RawGaussians:
    return RawGaussians.from_gaussians(oracle.random_gaussians(count, degree, seed))


def target_of(raw: RawGaussians) -> Target:
    image = rasterise(raw.to_gaussians(), PINHOLE, BLEND)
    return Target.of(image, np.ones(image.shape[:2], bool), TONE_SCALE)


def optimiser_of(raw: RawGaussians) -> CpuOptimiser:
    return CpuOptimiser(raw, AdamState.zeros(raw), BLEND)


def bits(optimiser: CpuOptimiser) -> list[bytes]:
    groups = optimiser.raw, optimiser.adam.mean, optimiser.adam.square
    return [getattr(group, name).tobytes() for group in groups for name in NAMES] + [optimiser.adam.steps.tobytes()]


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_steps_lower_the_loss(degree):
    optimiser, target = optimiser_of(random_raw(degree=degree)), target_of(random_raw(seed=7))
    losses = [optimiser.iterate(PINHOLE, target, RATES)[0] for _ in range(60)]
    assert losses[-1] < 0.7 * losses[0]


def test_the_loss_is_that_of_the_image_before_the_step():
    optimiser, target = optimiser_of(random_raw()), target_of(random_raw(seed=7))
    for _ in range(2):
        expected = image_loss(optimiser.render(PINHOLE), target).value
        assert optimiser.iterate(PINHOLE, target, RATES)[0] == expected


def test_it_draws_what_the_rasteriser_does():
    raw = random_raw(degree=2)
    expected = rasterise(raw.to_gaussians(), PINHOLE, BLEND)
    # Activated in single precision, as in test_trainer.py.
    np.testing.assert_allclose(optimiser_of(raw).render(PINHOLE), expected, rtol=1e-4, atol=1e-4 * expected.max())


def test_only_the_gaussians_change():
    raw = random_raw()
    optimiser = optimiser_of(raw)
    assert optimiser.raw is raw
    before = [getattr(raw, name).copy() for name in NAMES]
    _, found = optimiser.iterate(PINHOLE, target_of(random_raw(seed=7)), RATES)
    assert all((getattr(raw, name) != old).any() for name, old in zip(NAMES, before, strict=True))
    assert all(statistic.shape == (60,) for statistic in found[:4])
    assert found.error.sum() > 0


def test_colours_never_fall_below_black():
    """Black views pull every colour down, by steps far larger than the colours are."""
    raw = random_raw()
    optimiser = optimiser_of(raw)
    black = Target.of(np.zeros((40, 48, 3), np.float32), np.ones((40, 48), bool), TONE_SCALE)
    for _ in range(3):
        optimiser.iterate(PINHOLE, black, RATES | {"sh": 100.0})
        assert (raw.sh >= 0).all()
    assert (raw.sh == 0).sum() > 20


def test_a_colour_at_black_can_come_back():
    raw = random_raw()
    light, optimiser = target_of(raw), optimiser_of(raw)
    raw.sh[:] = 0
    for _ in range(5):
        optimiser.iterate(PINHOLE, light, RATES)
    assert (raw.sh > 0).any(axis=(1, 2)).sum() > 20


def test_who_is_out_of_view_keeps_its_bits():
    raw = random_raw()
    raw.position[::2] += np.float32(100) * CAMERA.world_from_view[:3, 2].astype(np.float32)  # behind the eye
    optimiser = optimiser_of(raw)
    before = {name: getattr(raw, name).copy() for name in NAMES}
    target = target_of(random_raw(seed=7))
    for _ in range(3):
        optimiser.iterate(PINHOLE, target, RATES)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(raw, name)[::2], before[name][::2])
        assert not getattr(optimiser.adam.mean, name)[::2].any()
    assert not optimiser.adam.steps[::2].any()
    assert (optimiser.adam.steps[1::2] == 3).sum() > 20


def test_what_is_masked_out_steps_nothing():
    optimiser = optimiser_of(random_raw())
    before = bits(optimiser)
    nothing = Target.of(np.zeros((40, 48, 3), np.float32), np.zeros((40, 48), bool), TONE_SCALE)
    loss, found = optimiser.iterate(PINHOLE, nothing, RATES)
    assert loss == 0
    assert not found.error.any()
    assert bits(optimiser) == before


def broken_loss(monkeypatch, **changes):
    """The loss as it is, but for some of its fields, which are functions of what they were."""

    def loss_of(image, target):
        loss = image_loss(image, target)
        return loss._replace(**{name: change(getattr(loss, name)) for name, change in changes.items()})

    monkeypatch.setattr(module, "image_loss", loss_of)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_loss_that_is_not_finite_stops_before_the_step(monkeypatch, value):
    optimiser, target = optimiser_of(random_raw()), target_of(random_raw(seed=7))
    optimiser.iterate(PINHOLE, target, RATES)
    before = bits(optimiser)
    broken_loss(monkeypatch, value=lambda _: value)
    with pytest.raises(FloatingPointError, match=f"loss is {value}"):
        optimiser.iterate(PINHOLE, target, RATES)
    assert bits(optimiser) == before


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_gradient_that_is_not_finite_names_its_gaussian_and_steps_nothing(monkeypatch, value):
    raw = random_raw()
    raw.position[:] += np.float32(100) * CAMERA.world_from_view[:3, 2].astype(np.float32)  # behind the eye
    raw.position[41] = CAMERA.position - CAMERA.world_from_view[:3, 2]  # the only one in view
    optimiser, target = optimiser_of(raw), target_of(random_raw(seed=7))
    optimiser.iterate(PINHOLE, target, RATES)
    before = bits(optimiser)
    broken_loss(monkeypatch, by_image=lambda by_image: np.full_like(by_image, value))
    with pytest.raises(FloatingPointError, match="Gaussian 41 "):
        optimiser.iterate(PINHOLE, target, RATES)
    assert bits(optimiser) == before


def test_it_goes_on_after_an_error(monkeypatch):
    optimiser, other = optimiser_of(random_raw()), optimiser_of(random_raw())
    target = target_of(random_raw(seed=7))
    with monkeypatch.context() as context:
        broken_loss(context, by_image=lambda by_image: np.full_like(by_image, np.nan))
        with pytest.raises(FloatingPointError):
            optimiser.iterate(PINHOLE, target, RATES)
    optimiser.iterate(PINHOLE, target, RATES)
    other.iterate(PINHOLE, target, RATES)
    assert bits(optimiser) == bits(other)


@pytest.mark.parametrize("count", [0, 1])
def test_almost_no_gaussians(count):
    loss, found = optimiser_of(random_raw(count)).iterate(PINHOLE, target_of(random_raw()), RATES)
    assert loss > 0
    assert len(found.error) == count
