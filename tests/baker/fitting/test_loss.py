"""The loss of the fit against definitions and a second implementation."""

import numpy as np
import pytest
import torch

from gsgi.baker.evaluation import metrics
from gsgi.baker.fitting.loss import Loss, image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.native import kernels
from gsgi.baker.over import cuda_loss

SCALE = 0.5
# Smaller than one window row, one band of rows or one strip of columns; exactly that; and more.
SIZES = [(11, 11), (12, 13), (40, 31), (64, 43), (65, 44), (75, 130), (203, 97)]


def images(shape=(40, 31), seed: int = 0, dtype=np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Light and noisy light, of which some is black."""
    rng = np.random.default_rng(seed)
    light = rng.gamma(1, 0.5, (*shape, 3)) * (rng.uniform(size=(*shape, 1)) > 0.1)
    noisy = np.maximum(light + rng.normal(0, 0.1, light.shape), 0)
    return noisy.astype(dtype), light.astype(np.float32)


def target_of(light: np.ndarray, valid: np.ndarray | None = None) -> Target:
    return Target.of(light, np.ones(light.shape[:2], bool) if valid is None else valid, SCALE)


def twin(image: np.ndarray, target: Target) -> Loss:
    """The loss by torch, in double."""
    x = torch.from_numpy(image.astype(np.float64)).requires_grad_()
    arguments = torch.from_numpy(target.tone / 65535), torch.from_numpy(target.valid), target.tone_scale
    value = cuda_loss.image_loss(x, *arguments)
    value.backward()
    return Loss(value.item(), x.grad.numpy(), cuda_loss.error(x.detach(), *arguments).numpy())


# Float32 keeps means of numbers below 1 to 1e-7. C2 = 9e-4 in the denominator makes that 1e-4 in a window without any
# contrast; these have some, and their sums average it.
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-12), (np.float32, 1e-5)])
@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("masked", [False, True])
def test_value_gradient_and_error_equal_torch(shape, dtype, tolerance, masked):
    image, light = images(shape, dtype=dtype)
    valid = np.random.default_rng(1).uniform(size=shape) > (0.3 if masked else -1)
    target = target_of(light, valid)
    ours, theirs = image_loss(image, target), twin(image, target)
    assert ours.by_image.dtype == ours.error.dtype == dtype
    assert ours.value == pytest.approx(theirs.value, rel=tolerance)
    np.testing.assert_allclose(ours.by_image, theirs.by_image, atol=tolerance * np.abs(theirs.by_image).max())
    np.testing.assert_allclose(ours.error, theirs.error, atol=tolerance)


def test_near_the_target_float32_is_as_good():
    """Where SSIM is near 1, 1 - SSIM is all that drives the fit."""
    _, light = images((60, 50))
    target = target_of(light)
    image = target.indirect * np.float32(1.001)
    ours, theirs = image_loss(image, target), twin(image, target)
    assert theirs.value < 1e-3
    assert ours.value == pytest.approx(theirs.value, rel=1e-3)
    # Behind the tone curve the images differ by 2e-4, in which float32 leaves 3e-4 of error.
    np.testing.assert_allclose(ours.by_image, theirs.by_image, atol=1e-3 * np.abs(theirs.by_image).max())


def test_gradient_matches_finite_differences():
    image, light = images((12, 13), dtype=np.float64)
    target, step = target_of(light), 1e-6
    image += 1e-3  # away from black, below which there is no image
    ours = image_loss(image, target).by_image
    for index in np.random.default_rng(0).integers(0, image.size, 40):
        there, back = image.copy(), image.copy()
        there.flat[index] += step
        back.flat[index] -= step
        expected = (image_loss(there, target).value - image_loss(back, target).value) / (2 * step)
        assert ours.flat[index] == pytest.approx(expected, abs=1e-8)


def test_ssim_equals_scikit_images():
    image, light = images(dtype=np.float64)
    target = target_of(light)
    a, b = image / (image + SCALE), target.tone / 65535
    dssim = image_loss(image, target).value - 0.2 * np.abs(a - b).mean()
    assert 1 - 2 * dssim / 0.8 == pytest.approx(metrics.ssim(a, b), abs=1e-12)


def test_the_target_itself_has_no_loss():
    target = target_of(images(dtype=np.float64)[1])
    tone = target.tone / 65535
    loss = image_loss(SCALE * tone / (1 - tone), target)
    assert loss.value == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_same_bits_for_any_number_of_threads(dtype):
    image, light = images((203, 97), dtype=dtype)
    target = target_of(light)
    results = []
    for threads in (1, 2, 7):
        kernels.set_thread_count(threads)
        loss = image_loss(image, target)
        results.append((loss.value, loss.by_image.tobytes(), loss.error.tobytes()))
    kernels.set_thread_count(0)
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(5, 31), (70, 97)])
def test_same_bits_for_every_instruction_set(shape, dtype):
    image, light = images(shape, dtype=dtype)
    target = target_of(light, np.random.default_rng(1).uniform(size=shape) > 0.1)
    results = []
    for name in kernels.instruction_sets():
        kernels.set_instruction_set(name)  # the last is the default
        loss = image_loss(image, target)
        results.append((loss.value, loss.by_image.tobytes(), loss.error.tobytes()))
    assert all(result == results[0] for result in results)


def test_invalid_pixels_do_not_count_and_get_no_gradient():
    image, light = images()
    valid = np.zeros(image.shape[:2], bool)
    valid[:, :20] = True
    target = target_of(light, valid)
    loss = image_loss(image, target)
    assert not loss.by_image[:, 20:].any()
    assert not loss.error[:, 20:].any()
    assert loss.by_image[:, :20].any(axis=2).sum() > 700
    for anything in (7.0, np.nan, -1.0):
        image[:, 20:] = anything
        other = image_loss(image, target)
        assert other.value == loss.value
        np.testing.assert_array_equal(other.by_image, loss.by_image)


@pytest.mark.parametrize("shape", [(1, 1), (10, 40), (40, 10), (3, 70), (0, 5)])
def test_images_without_a_window_have_l1_alone(shape):
    image_loss(*(a if i == 0 else target_of(a) for i, a in enumerate(images((40, shape[1] or 1)))))  # leaves no trace
    image, light = images(shape, dtype=np.float64)
    target = target_of(light)
    difference = image / (image + SCALE) - target.tone / 65535
    loss = image_loss(image, target)
    count = max(difference.size, 1)
    assert loss.value == pytest.approx(0.2 * np.abs(difference).sum() / count, rel=1e-12)
    np.testing.assert_allclose(loss.error, 0.2 * np.abs(difference).mean(axis=2), rtol=1e-12)
    np.testing.assert_allclose(
        loss.by_image, 0.2 / count * np.sign(difference) * SCALE / (image + SCALE) ** 2, rtol=1e-12
    )


@pytest.mark.parametrize("shape", [(40, 31), (5, 31)])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1e-3, -SCALE])
def test_light_that_cannot_be_makes_the_loss_nan_once(shape, value):
    image, light = images(shape)
    target = target_of(light)
    good = image_loss(image, target)
    broken = image.copy()
    broken[4, 30, 2] = value
    assert np.isnan(image_loss(broken, target).value)
    again = image_loss(image, target)
    assert again.value == good.value
    np.testing.assert_array_equal(again.by_image, good.by_image)


def test_extremes_of_light_stay_finite():
    image, light = images()
    image[::2], light[1::3] = np.finfo(np.float32).max, 1e30
    image[1, 1], light[2, 2] = 1e-45, 1e-45
    loss = image_loss(image, target_of(light))
    assert np.isfinite(loss.value)
    assert np.isfinite(loss.by_image).all()
    assert np.isfinite(loss.error).all()


def test_what_does_not_fit_is_refused():
    image, light = images()
    target = target_of(light)
    for wrong in (
        image[1:],
        image[:, 1:].copy(),
        image[..., :2].copy(),
        image[..., 0],
        image.astype(np.float16),
        image[::2],
    ):
        with pytest.raises(TypeError):
            image_loss(wrong, target)
