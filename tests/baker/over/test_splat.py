"""Closed form == numpy oracle == torch twin == C++ kernel, forward and backward; hard numerical cases."""

import numpy as np
import oracle
import pytest
import scenes
import torch
from torch_kernel_splat import splat

from gsgi.baker.native import kernels
from gsgi.baker.over.rasterise import rasterise
from gsgi.runtime.constants import ALPHA_MAX, SH_C0
from gsgi.runtime.gaussians import Gaussians, OverBlend

NAMES = ("position", "rotation", "scale", "opacity", "sh")
BLEND = OverBlend(near=0.01)
CAMERA = scenes.inside_camera()
PINHOLE = CAMERA.pinhole(48, 40)

# Single precision: some 1e-6 per Gaussian from exp and from the position in the tile, up to 50 Gaussians per pixel.
FLOAT_TOLERANCE = 1e-4
DOUBLE_TOLERANCE = 1e-10


def tensors(gaussians: Gaussians, dtype=torch.float64) -> list[torch.Tensor]:
    return [torch.tensor(getattr(gaussians, name), dtype=dtype, requires_grad=True) for name in NAMES]


def gaussian(view=(0.0, 0.0, -1.0), scale=(0.05, 0.05, 0.05), rotation=(0, 0, 0, 1), opacity=0.8, colour=(1, 2, 3)):
    """One Gaussian at a view-space position of CAMERA, its axes along the camera's unless turned by `rotation`."""
    position = CAMERA.world_from_view[:3, :3] @ np.asarray(view, float) + CAMERA.position
    quaternion = multiply(quaternion_of(CAMERA.world_from_view[:3, :3]), np.asarray(rotation, float))
    sh = np.asarray(colour, float)[None] / SH_C0
    return Gaussians(*(np.asarray(a, np.float32)[None] for a in (position, quaternion, scale, opacity, sh)))


def quaternion_of(matrix: np.ndarray) -> np.ndarray:
    w = np.sqrt(1 + np.trace(matrix)) / 2
    m = matrix - matrix.T
    return np.array([m[2, 1], m[0, 2], m[1, 0], 4 * w * w]) / (4 * w)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def concatenate(*parts: Gaussians) -> Gaussians:
    return Gaussians(*(np.concatenate([getattr(part, name) for part in parts]) for name in NAMES))


def test_one_gaussian_has_the_closed_form():
    pinhole = CAMERA.pinhole(33, 17)  # the middle of the image is the centre of pixel (8, 16)
    image = rasterise(gaussian(opacity=0.75), pinhole, BLEND)
    np.testing.assert_allclose(image[8, 16], 0.75 * np.array([1, 2, 3]), rtol=1e-5)
    # On the axis the Jacobian is f/d in both directions: a round spot of that variance.
    variance = (0.05 * pinhole.fx) ** 2 + BLEND.dilation
    columns, rows = np.meshgrid(np.arange(33) - 16, np.arange(17) - 8)
    alpha = 0.75 * np.exp(-0.5 * (columns**2 + rows**2) / variance)
    expected = np.where(alpha >= BLEND.alpha_min, alpha, 0)[..., None] * [1, 2, 3]
    np.testing.assert_allclose(image, expected, atol=1e-5)


def test_near_opaque_gaussian_hides_the_far_one_whatever_their_order():
    near = gaussian((0, 0, -1), scale=(10, 10, 0.01), opacity=1, colour=(1, 0, 0))
    far = gaussian((0, 0, -2), scale=(20, 20, 0.01), opacity=1, colour=(0, 1, 0))
    expected = [ALPHA_MAX, (1 - ALPHA_MAX) * ALPHA_MAX, 0]
    for scene in (concatenate(near, far), concatenate(far, near)):
        assert np.allclose(rasterise(scene, PINHOLE, BLEND), expected, rtol=1e-5)


def test_negative_colour_is_cut_and_has_no_gradient():
    scene = gaussian(colour=(1, -1, 0))
    parameters = tensors(scene)
    image, _ = splat(*parameters, PINHOLE, BLEND)
    (by_sh,) = torch.autograd.grad(image.sum(), parameters[4:])
    assert image[..., 0].max() > 0
    assert not image[..., 1:].any()
    assert by_sh[0, 0, 0] > 0
    assert by_sh[0, 0, 1] == 0
    assert by_sh[0, 0, 2] > 0  # zero itself can still grow: SH may start at zero


def test_non_contiguous_tensors_are_accepted():
    parameters = tensors(oracle.random_gaussians(20, 1, seed=4))
    strided = [torch.stack([p, p], dim=-1)[..., 0] for p in parameters]
    assert not strided[0].is_contiguous()
    assert torch.equal(splat(*strided, PINHOLE, BLEND)[0], splat(*parameters, PINHOLE, BLEND)[0])
    image, _ = splat(*strided, PINHOLE, BLEND)
    image.sum().backward()  # the gradient of a sum arrives with stride 0
    assert parameters[0].grad.abs().max() > 0


def test_splat_rejects_mixed_dtypes():
    parameters = tensors(oracle.random_gaussians(5, 0, seed=1), torch.float32)
    with pytest.raises(TypeError):
        splat(parameters[0].double(), *parameters[1:], PINHOLE, BLEND)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_gradient_of_the_kernels_that_is_not_finite_is_refused(value):
    given, pinhole = oracle.random_gaussians(50, 0, seed=20), scenes.inside_camera().pinhole(40, 30)
    arrays = given.position, given.rotation, given.scale, given.opacity, given.sh
    image, transmittance, frame = kernels.splat(*arrays, pinhole, OverBlend(0.01))
    by_image = np.ones_like(image)
    kernels.splat_backward(frame, *arrays, by_image, np.zeros_like(transmittance))
    by_image[15, 20] = value
    with pytest.raises(FloatingPointError, match=r"gradient of Gaussian \d+ is not finite"):
        kernels.splat_backward(frame, *arrays, by_image, np.zeros_like(transmittance))
