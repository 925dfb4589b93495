"""The loss of the fit against definitions and a second implementation."""

import numpy as np
import pytest
import torch

from gsgi.baker import loss, metrics


def images(seed: int = 0, shape=(40, 31, 3)):
    rng = np.random.default_rng(seed)
    base = rng.uniform(0, 1, shape)
    return base.astype(np.float32), np.clip(base + rng.normal(0, 0.1, shape), 0, 1).astype(np.float32)


def test_ssim_equals_scikit_images():
    a, b = images()
    ours = loss.ssim(torch.from_numpy(a).double(), torch.from_numpy(b).double()).item()
    assert ours == pytest.approx(metrics.ssim(a, b), abs=1e-6)
    assert loss.ssim(torch.from_numpy(a), torch.from_numpy(a)).item() == pytest.approx(1, abs=1e-6)


def test_loss_is_zero_for_the_target_and_weighs_l1_and_dssim():
    a, b = (torch.from_numpy(image).double() for image in images())
    valid = torch.ones(a.shape[:2], dtype=torch.bool)
    assert loss.image_loss(a, a, valid, 0.5).item() == pytest.approx(0, abs=1e-12)
    x, y = a / (a + 0.5), b / (b + 0.5)
    expected = 0.2 * (x - y).abs().mean() + 0.8 * (1 - loss.ssim(x, y)) / 2
    assert loss.image_loss(a, b, valid, 0.5).item() == pytest.approx(expected.item(), rel=1e-12)


def test_invalid_pixels_do_not_count_and_get_no_gradient():
    a, b = (torch.from_numpy(image) for image in images())
    valid = torch.zeros(a.shape[:2], dtype=torch.bool)
    valid[:, :20] = True
    a.requires_grad_()
    value = loss.image_loss(a, b, valid, 0.5)
    value.backward()
    assert a.grad[:, 20:].abs().max() == 0
    assert a.grad[:, :20].abs().max() > 0
    changed = a.detach().clone()
    changed[:, 20:] = 7.0
    assert loss.image_loss(changed, b, valid, 0.5) == value


def test_an_image_without_any_surface_has_a_finite_loss():
    a, b = (torch.from_numpy(image) for image in images())
    assert loss.image_loss(a, b, torch.zeros(a.shape[:2], dtype=torch.bool), 0.5).item() == pytest.approx(0, abs=1e-6)


def test_gradients_match_finite_differences():
    a, b = (torch.from_numpy(image).double() for image in images(shape=(12, 13, 3)))
    valid = torch.ones(12, 13, dtype=torch.bool)
    assert torch.autograd.gradcheck(lambda x: loss.image_loss(x, b, valid, 0.5), a.requires_grad_(), atol=1e-7)
