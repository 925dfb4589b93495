"""The compiled module by itself: its basis, what it refuses, threads, and what importing it must not change."""

import os
import signal
import threading
import time

import numpy as np
import oracle
import pytest
import scenes

from gsgi.baker.native import kernels
from gsgi.runtime import constants
from gsgi.runtime.gaussians import OverBlend

BLEND = OverBlend(near=0.01)
PINHOLE = scenes.inside_camera().pinhole(48, 40)


def arrays(n: int = 40, degree: int = 2, dtype=np.float32) -> list[np.ndarray]:
    g = oracle.random_gaussians(n, degree, seed=3)
    return [a.astype(dtype) for a in (g.position, g.rotation, g.scale, g.opacity, g.sh)]


def sphere_quadrature(count: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Directions (M, 3) and weights (M,) that integrate polynomials of degree 2 * count - 1 exactly."""
    z, weight = np.polynomial.legendre.leggauss(count)
    azimuth = np.arange(2 * count) * np.pi / count
    z, azimuth = (a.ravel() for a in np.meshgrid(z, azimuth, indexing="ij"))
    radius = np.sqrt(1 - z * z)
    direction = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)
    return direction, np.repeat(weight, 2 * count) * np.pi / count


@pytest.mark.parametrize("basis", [oracle.sh_basis, kernels.sh_basis], ids=["oracle", "kernel"])
def test_sh_basis_is_orthonormal(basis):
    direction, weight = sphere_quadrature()
    values = basis(direction, 3)
    np.testing.assert_allclose(values.T @ (weight[:, None] * values), np.eye(16), atol=1e-14)


@pytest.mark.parametrize("degree", range(4))
def test_sh_basis_equals_oracle(degree):
    direction, _ = sphere_quadrature()
    expected = oracle.sh_basis(direction, degree)
    np.testing.assert_allclose(kernels.sh_basis(direction, degree), expected, atol=1e-14)


def test_constants_are_shared():
    assert constants.TILE_SIZE == kernels.TILE_SIZE


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_same_bits_for_any_number_of_threads(dtype):
    inputs = arrays(500, 3, dtype)
    by_image = np.random.default_rng(0).normal(size=(90, 130, 3)).astype(dtype)
    results = []
    for threads in (1, 2, 7):
        kernels.set_thread_count(threads)
        assert kernels.thread_count() == threads
        image, transmittance, frame = kernels.splat(*inputs, scenes.inside_camera().pinhole(130, 90), BLEND)
        gradients = kernels.splat_backward(frame, *inputs, by_image, by_image[..., 0].copy())
        results.append([a.tobytes() for a in (image, transmittance, *gradients)])
    kernels.set_thread_count(0)
    assert results[0] == results[1] == results[2]


@pytest.fixture(params=kernels.instruction_sets())
def instruction_set(request):
    kernels.set_instruction_set(request.param)
    yield request.param
    kernels.set_instruction_set(kernels.instruction_sets()[-1])


def splat_bits(count: int, dtype) -> list[bytes]:
    inputs = arrays(count, 3, dtype)
    by_image = np.random.default_rng(0).normal(size=(50, 70, 3)).astype(dtype)
    image, transmittance, frame = kernels.splat(*inputs, scenes.inside_camera().pinhole(70, 50), BLEND)
    gradients = kernels.splat_backward(frame, *inputs, by_image, by_image[..., 0].copy())
    return [a.tobytes() for a in (image, transmittance, *gradients)]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_same_bits_for_every_instruction_set(dtype):
    assert kernels.instruction_sets()[0] == "scalar"
    results = []
    for name in kernels.instruction_sets():
        kernels.set_instruction_set(name)  # the last is the default
        results.append(splat_bits(100, dtype))
    assert all(result == results[0] for result in results)


def test_unknown_instruction_set_is_refused():
    with pytest.raises(ValueError, match="abacus"):
        kernels.set_instruction_set("abacus")


def test_threads_outlive_a_fork():
    """The child has none of the parent's threads, and must not wait for them."""
    kernels.set_thread_count(3)
    expected = splat_bits(200, np.float32)
    child = os.fork()
    if child == 0:
        os._exit(0 if splat_bits(200, np.float32) == expected else 1)
    kernels.set_thread_count(0)
    deadline = time.monotonic() + 60
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            pytest.fail("the child hangs")
        time.sleep(0.01)
    assert ended[1] == 0


@pytest.mark.parametrize("index", range(5))
def test_splat_rejects_wrong_dtype(index):
    inputs = arrays()
    inputs[index] = inputs[index].astype(np.float64)
    with pytest.raises(TypeError):
        kernels.splat(*inputs, PINHOLE, BLEND)


@pytest.mark.parametrize("index", range(5))
def test_splat_rejects_wrong_shape(index):
    for wrong in (lambda a: a[..., :-1].copy() if a.ndim > 1 else a[:, None], lambda a: a[:-1].copy()):
        inputs = arrays()
        inputs[index] = wrong(inputs[index])
        with pytest.raises(TypeError):
            kernels.splat(*inputs, PINHOLE, BLEND)


def test_splat_rejects_coefficients_of_no_degree():
    inputs = arrays()
    inputs[4] = inputs[4][:, :5].copy()
    with pytest.raises(TypeError, match="K one of 1, 4, 9, 16"):
        kernels.splat(*inputs, PINHOLE, BLEND)


def test_splat_backward_rejects_gradient_of_another_size():
    inputs = arrays()
    image, transmittance, frame = kernels.splat(*inputs, PINHOLE, BLEND)
    with pytest.raises(TypeError):
        kernels.splat_backward(frame, *inputs, image[1:], transmittance[1:])
    with pytest.raises(TypeError):
        kernels.splat_backward(frame, *(a[1:] for a in inputs), image, transmittance)


@pytest.mark.parametrize(
    ("pinhole", "blend"),
    [
        (PINHOLE._replace(width=0), BLEND),
        (PINHOLE._replace(fx=0.0), BLEND),
        (PINHOLE, OverBlend(near=0.01, alpha_max=1.0)),
        (PINHOLE, OverBlend(near=0.01, alpha_min=0.0)),
        (PINHOLE, OverBlend(near=0.01, dilation=-0.1)),
    ],
)
def test_splat_rejects_impossible_camera_and_blend(pinhole, blend):
    with pytest.raises(ValueError, match=r"pinhole|blend"):
        kernels.splat(*arrays(), pinhole, blend)


def test_denormals_survive(instruction_set):
    """A module linked with -ffast-math would turn on flush-to-zero for the process or for the calling thread."""
    smallest = []

    def halve():
        kernels.splat(*arrays(), PINHOLE, BLEND)
        smallest.append(np.array([1e-40], np.float32) * np.float32(0.5))

    halve()
    thread = threading.Thread(target=halve)
    thread.start()
    thread.join()
    assert len(smallest) == 2
    assert all(value > 0 for value in smallest)
