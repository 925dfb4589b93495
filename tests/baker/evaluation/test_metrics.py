"""PSNR, SSIM and FLIP: known values, and independence of a reference's noise."""

import numpy as np
import pytest

from gsgi.baker.evaluation import metrics


def picture(seed: int = 0, shape=(48, 64, 3)) -> np.ndarray:
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / 16.0
    waves = np.stack([np.sin(x), np.cos(y), np.sin(x + y)], axis=-1)
    return (0.5 + 0.4 * waves).astype(np.float32)


def test_equal_images_have_no_difference():
    difference = metrics.compare_display(picture(), picture())
    assert difference.psnr == 100
    assert difference.ssim == pytest.approx(1)
    assert difference.flip == pytest.approx(0, abs=1e-6)


def test_psnr_of_a_constant_offset():
    image = picture()
    assert metrics.compare_display(image + np.float32(0.1), image).psnr == pytest.approx(20, abs=1e-4)


def test_noise_of_the_halves_does_not_count_as_error():
    rng = np.random.default_rng(0)
    truth = picture(shape=(256, 256, 3))
    a, b = (truth + rng.normal(0, 0.2, truth.shape).astype(np.float32) for _ in range(2))
    image = truth + np.float32(0.05)
    clean = metrics.compare_linear(image, truth, truth, truth, exposure=1.0).psnr
    noisy = metrics.compare_linear(image, a, b, truth, exposure=1.0).psnr
    naive = metrics.compare_linear(image, a, a, truth, exposure=1.0).psnr
    assert clean == pytest.approx(-20 * np.log10(0.05), abs=1e-3)
    assert noisy == pytest.approx(clean, abs=0.3)
    assert naive < clean - 8


def test_a_few_bright_pixels_do_not_rule_what_a_display_shows():
    truth = picture(shape=(64, 64, 3))
    image = truth.copy()
    truth[:2, :2], image[:2, :2] = 1000, 900
    found = metrics.compare_linear(image, truth, truth, truth, exposure=1.0)
    assert found.psnr < 0
    assert found.shown_psnr > 60
    shown = metrics.compare_display(image, truth)
    assert shown.shown_psnr == shown.psnr


def test_a_mean_psnr_is_of_the_mean_squared_error():
    assert metrics.mean_psnr([20.0, 20.0]) == pytest.approx(20)
    assert metrics.mean_psnr([10.0, 100.0]) == pytest.approx(10 + 10 * np.log10(2), abs=1e-6)


def test_exposure_comes_from_the_reference_alone():
    image, truth = picture() * 0.9, picture()
    dim = metrics.compare_linear(image / 1000, truth / 1000, truth / 1000, truth / 1000)
    bright = metrics.compare_linear(image, truth, truth, truth)
    assert dim.psnr == pytest.approx(bright.psnr, abs=1e-3)
    assert dim.ssim == pytest.approx(bright.ssim, abs=1e-5)
    assert dim.flip == pytest.approx(bright.flip, abs=1e-5)


def test_ssim_equals_wang_2004_written_out():
    rng = np.random.default_rng(1)
    a = picture()[:20, :24, :1].repeat(3, axis=2)
    b = np.clip(a + rng.normal(0, 0.1, a.shape), 0, 1).astype(np.float32)
    x = np.arange(11) - 5
    window = np.exp(-(x[:, None] ** 2 + x**2) / (2 * 1.5**2))
    window /= window.sum()
    values = []
    for i in range(a.shape[0] - 10):
        for j in range(a.shape[1] - 10):
            for c in range(3):
                p, q = (image[i : i + 11, j : j + 11, c].astype(np.float64) for image in (a, b))
                mp, mq = (window * p).sum(), (window * q).sum()
                vp, vq = (window * (p - mp) ** 2).sum(), (window * (q - mq) ** 2).sum()
                cov = (window * (p - mp) * (q - mq)).sum()
                values.append((2 * mp * mq + 1e-4) * (2 * cov + 9e-4) / ((mp**2 + mq**2 + 1e-4) * (vp + vq + 9e-4)))
    assert metrics.ssim(a, b) == pytest.approx(np.mean(values), abs=1e-5)


def test_flip_grows_with_the_difference():
    image = picture()
    small, large = (metrics.flip(np.clip(image + d, 0, 1).astype(np.float32), image) for d in (0.02, 0.2))
    assert 0 < small < large < 1


def test_pixels_outside_the_mask_do_not_count():
    truth = picture()
    valid = np.zeros(truth.shape[:2], bool)
    valid[8:40, 8:40] = True
    spoilt = np.where(valid[..., None], truth + np.float32(0.1), np.float32(0))
    inside = metrics.compare_linear(spoilt, truth, truth, truth, exposure=1.0, valid=valid)
    assert inside.psnr == pytest.approx(20, abs=1e-3)
    everywhere = metrics.compare_linear(spoilt, truth, truth, truth, exposure=1.0)
    assert everywhere.psnr < 15
    assert everywhere.flip > inside.flip
