"""Closed form == numpy oracle == torch twin == C++ kernel, forward and backward; hard numerical cases."""

import dataclasses

import numpy as np
import oracle
import pytest
import scenes
import torch
import torch_splat
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


def about_z(angle: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)


def gradients(function, parameters, pinhole=PINHOLE, blend=BLEND) -> list[torch.Tensor]:
    """Of a fixed random linear function of image and transmittance, in double precision."""
    image, transmittance = function(*parameters, pinhole, blend)
    generator = torch.Generator().manual_seed(5)
    weight = torch.randn(*image.shape[:2], 4, generator=generator, dtype=torch.float64)
    loss = (image * weight[..., :3]).sum() + (transmittance * weight[..., 3]).sum()
    return [g.double() for g in torch.autograd.grad(loss, parameters)]


def assert_close(actual, expected, tolerance: float):
    """Within `tolerance` of the value or of the largest value."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max())


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


def test_gaussian_is_not_drawn_before_the_near_plane():
    for depth, drawn in ((0.99, False), (1.01, True)):
        assert rasterise(gaussian((0, 0, -depth)), PINHOLE, OverBlend(near=1.0)).any() == drawn


@pytest.mark.parametrize("degree", range(4))
def test_oracle_twin_and_kernel_agree(degree):
    scene = oracle.random_gaussians(50, degree, seed=degree)
    expected = oracle.splat(scene, PINHOLE, BLEND)
    assert 0.05 < expected[1].mean() < 0.6  # the scene is neither empty nor all opaque
    with torch.no_grad():
        for actual, reference in zip(torch_splat.splat(*tensors(scene), PINHOLE, BLEND), expected, strict=True):
            assert_close(actual, reference, DOUBLE_TOLERANCE)
        for actual, reference in zip(splat(*tensors(scene), PINHOLE, BLEND), expected, strict=True):
            assert_close(actual, reference, DOUBLE_TOLERANCE)
        for actual, reference in zip(splat(*tensors(scene, torch.float32), PINHOLE, BLEND), expected, strict=True):
            assert actual.dtype == torch.float32
            assert_close(actual, reference, FLOAT_TOLERANCE)
    np.testing.assert_array_equal(
        rasterise(scene, PINHOLE, BLEND), splat(*tensors(scene, torch.float32), PINHOLE, BLEND)[0].detach()
    )


@pytest.mark.parametrize(("width", "height"), [(17, 33), (1, 1), (16, 16), (15, 31)])
def test_images_of_any_size_equal_the_oracle(width, height):
    scene, pinhole = oracle.random_gaussians(60, 1, seed=9), CAMERA.pinhole(width, height)
    image, transmittance = splat(*tensors(scene), pinhole, BLEND)
    expected = oracle.splat(scene, pinhole, BLEND)
    assert_close(image.detach(), expected[0], DOUBLE_TOLERANCE)
    assert_close(transmittance.detach(), expected[1], DOUBLE_TOLERANCE)


def test_principal_point_and_unequal_focal_lengths_equal_the_oracle():
    scene = oracle.random_gaussians(60, 1, seed=9)
    pinhole = PINHOLE._replace(fx=30.0, fy=55.0, cx=10.25, cy=33.5)
    assert_close(splat(*tensors(scene), pinhole, BLEND)[0].detach(), oracle.splat(scene, pinhole, BLEND)[0], 1e-10)


def test_needles_of_any_direction_equal_the_oracle():
    """Tiles are listed by the exact extent of the ellipse: a needle must not lose its tips."""
    pinhole = CAMERA.pinhole(130, 110)
    for angle in np.arange(8) * np.pi / 8 + 0.1:
        scene = gaussian((0.05, 0.02, -1), (0.5, 0.001, 0.001), about_z(angle), opacity=0.99)
        expected = oracle.splat(scene, pinhole, BLEND)[0]
        assert_close(splat(*tensors(scene), pinhole, BLEND)[0].detach(), expected, DOUBLE_TOLERANCE)
        assert_close(rasterise(scene, pinhole, BLEND), expected, FLOAT_TOLERANCE)


def finite_difference_scene() -> tuple[Gaussians, OverBlend]:
    """Off every cut-off: no alpha reaches alpha_max, no pixel ends, the step at alpha_min is too small to see.

    A round one, a needle at 45 degrees, one beyond the frustum clamp on both axes, and one turned about a slanted axis.
    """
    slanted = np.array([0.5, -0.3, 0.4, 0.7]) / np.linalg.norm([0.5, -0.3, 0.4, 0.7])
    parts = [
        gaussian((0.05, 0.1, -1.0), (0.1, 0.1, 0.1), opacity=0.5),
        gaussian((-0.1, 0.05, -1.5), (0.4, 0.01, 0.02), about_z(np.pi / 4), 0.7, (2, 0.5, 1)),
        gaussian((1.3, 1.1, -1.2), (0.5, 0.6, 0.4), about_z(1.0), 0.6, (0.5, 1, 0.2)),
        gaussian((0.1, -0.2, -2.0), (0.3, 0.1, 0.2), slanted, 0.4, (0.3, 2, 1)),
    ]
    scene = concatenate(*parts)
    rng = np.random.default_rng(1)
    sh = np.concatenate([scene.sh, 0.2 * rng.normal(size=(4, 15, 3))], axis=1).astype(np.float32)
    return dataclasses.replace(scene, sh=sh), OverBlend(near=0.01, alpha_min=1e-14)


def test_gradients_equal_finite_differences():
    scene, blend = finite_difference_scene()
    pinhole = CAMERA.pinhole(24, 20)
    parameters = tensors(scene)
    weight = np.random.default_rng(2).normal(size=(20, 24, 4))

    def loss(*values):
        image, transmittance = splat(*values, pinhole, blend)
        return (image * torch.from_numpy(weight[..., :3])).sum() + (
            transmittance * torch.from_numpy(weight[..., 3])
        ).sum()

    actual = torch.autograd.grad(loss(*parameters), parameters)
    step = 1e-5
    for k, name in enumerate(NAMES):
        expected = torch.zeros_like(actual[k])
        for i in range(expected.numel()):
            ends = []
            for sign in (1, -1):
                moved = [p.detach().clone() for p in parameters]
                moved[k].view(-1)[i] += sign * step
                ends.append(loss(*moved))
            expected.view(-1)[i] = (ends[0] - ends[1]) / (2 * step)
        assert (expected.abs().amax(dim=tuple(range(1, expected.ndim))) > 1e-3).all(), name  # every Gaussian is tested
        # Central differences: truncation of order step^2, rounding of order 1e-16 / step.
        np.testing.assert_allclose(
            actual[k], expected, rtol=1e-6, atol=1e-7 * float(expected.abs().max()), err_msg=name
        )


@pytest.mark.parametrize("degree", range(4))
def test_gradients_equal_the_twin(degree):
    scene = oracle.random_gaussians(50, degree, seed=20 + degree)
    expected = gradients(torch_splat.splat, tensors(scene))
    for dtype, tolerance in ((torch.float64, 1e-9), (torch.float32, FLOAT_TOLERANCE)):
        for name, a, b in zip(NAMES, gradients(splat, tensors(scene, dtype)), expected, strict=True):
            assert b.abs().max() > 0, name
            assert_close(a, b, tolerance)


def test_gradients_with_clamps_equal_the_twin():
    """Opaque Gaussians reach alpha_max and end pixels; others lie beyond the frustum clamp on one axis or both."""
    parts = [gaussian((x, y, -1.0), (0.4, 0.3, 0.2), about_z(x + y), 0.9) for x in (-1, 0.9) for y in (0.1, 1, -1.2)]
    parts += [gaussian((0.1 * k, 0, -2 - k), (1, 1, 0.1), about_z(k), 1.0, (k + 1, 1, 2)) for k in range(4)]
    scene = concatenate(*parts)
    for dtype, tolerance in ((torch.float64, 1e-9), (torch.float32, FLOAT_TOLERANCE)):
        expected = gradients(torch_splat.splat, tensors(scene))
        for a, b in zip(gradients(splat, tensors(scene, dtype)), expected, strict=True):
            assert_close(a, b, tolerance)


def test_gradients_of_needles_equal_the_twin():
    parts = [gaussian((0.02 * k, 0, -1 - 0.1 * k), (0.6, 0.002, 0.003), about_z(k * np.pi / 4), 0.6) for k in range(4)]
    expected = gradients(torch_splat.splat, tensors(concatenate(*parts)))
    for dtype, tolerance in ((torch.float64, 1e-9), (torch.float32, FLOAT_TOLERANCE)):
        for a, b in zip(gradients(splat, tensors(concatenate(*parts), dtype)), expected, strict=True):
            assert_close(a, b, tolerance)


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


HARD_CASES = {
    "none": lambda: oracle.random_gaussians(0, 1, 0),
    "zero scale": lambda: gaussian(scale=(0, 0, 0)),
    "giant": lambda: gaussian(scale=(1e6, 1e6, 1e6)),
    "giant needle": lambda: gaussian(scale=(1e6, 1e-6, 1e-6), rotation=about_z(np.pi / 4)),
    "largest float": lambda: gaussian(scale=(3e38, 3e38, 3e38)),
    "smallest float": lambda: gaussian(scale=(1e-45, 1e-45, 1e-45)),
    "at the eye": lambda: gaussian((0, 0, 0)),
    "just before the eye": lambda: gaussian((0, 0, -1e-30)),
    "beside the eye": lambda: gaussian((1, 1, -1e-30), scale=(1, 1, 1)),
    "behind the eye": lambda: gaussian((0, 0, 1)),
    "far": lambda: gaussian((0, 0, -1e30), scale=(1e29, 1e29, 1e29)),
    "grazing needle": lambda: gaussian((0, 0, -1), (1e-6, 1e-6, 1e3)),
    "opacity 0": lambda: gaussian(opacity=0),
    "opacity 1": lambda: gaussian(opacity=1),
    "negative opacity": lambda: gaussian(opacity=-1),
    "zero quaternion": lambda: dataclasses.replace(gaussian(), rotation=np.zeros((1, 4), np.float32)),
    "giant quaternion": lambda: dataclasses.replace(gaussian(), rotation=np.full((1, 4), 1e30, np.float32)),
    "black": lambda: gaussian(colour=(0, 0, 0)),
    "bright": lambda: gaussian(colour=(1e30, 1e30, 1e30)),
    "many at one place": lambda: concatenate(*[gaussian(opacity=1)] * 50),
}


@pytest.mark.parametrize("near", [0.0, 0.01])
@pytest.mark.parametrize("dilation", [0.0, 0.3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=["float32", "float64"])
@pytest.mark.parametrize("case", HARD_CASES)
def test_hard_cases_stay_finite(case, dtype, dilation, near):
    for width, height in ((1, 1), (33, 17)):
        parameters = tensors(HARD_CASES[case](), dtype)
        image, transmittance = splat(*parameters, CAMERA.pinhole(width, height), OverBlend(near, dilation))
        (image.sum() + transmittance.sum()).backward()
        assert image.isfinite().all()
        assert transmittance.isfinite().all()
        for name, parameter in zip(NAMES, parameters, strict=True):
            assert parameter.grad.isfinite().all(), name


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
