"""The GPU's iteration equals the CPU's. Without CUDA a twin stands in for gsplat; with it the same tests run both."""

import dataclasses
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import oracle
import pytest
import scenes
import torch
import torch_gsplat
import torch_splat
from torch_kernel_splat import splat

from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.over import cuda_loss, cuda_splat
from gsgi.baker.over.cuda_optimiser import CudaOptimiser
from gsgi.baker.over.cuda_splat import unavailable
from gsgi.baker.over.optimiser import CpuOptimiser, optimiser_class
from gsgi.baker.over.rasterise import rasterise
from gsgi.baker.over.raw_gaussians import NAMES, RawGaussians
from gsgi.baker.over.workspace import AdamState
from gsgi.runtime.constants import ADAM_BETA1, ADAM_BETA2, SH_C0
from gsgi.runtime.gaussians import Gaussians, OverBlend

BLEND = OverBlend(near=0.6, dilation=0.2)  # unlike gsplat's defaults; some Gaussians are nearer
CAMERA = scenes.inside_camera()
PINHOLE = CAMERA.pinhole(48, 40)._replace(fy=41.0)
RATES = {"position": 0.01, "rotation": 0.02, "log_scale": 0.03, "logit_opacity": 0.04, "sh": 0.05}
TOLERANCE = 1e-4  # single precision, as in test_splat.py

NO_CUDA = unavailable()
CUDA = pytest.param("cuda", marks=pytest.mark.skipif(NO_CUDA is not None, reason=str(NO_CUDA)))


@pytest.fixture(params=["cpu", CUDA])
def device(request, monkeypatch):
    threads = torch.get_num_threads()
    if request.param == "cpu":
        monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=torch_gsplat.rasterization))
        torch.set_num_threads(1)  # in images this small, threads only wait for one another
    yield request.param
    torch.set_num_threads(threads)


def thin_gaussians(count: int = 50, degree: int = 0, seed: int = 20) -> RawGaussians:
    """So little opaque that no cap is reached and no pixel ends: there gsplat does what our rasteriser does."""
    gaussians = oracle.random_gaussians(count, degree, seed)
    gaussians = dataclasses.replace(gaussians, opacity=0.3 * gaussians.opacity)
    assert oracle.splat(gaussians, PINHOLE, BLEND)[1].min() > 2e-4
    raw = RawGaussians.from_gaussians(gaussians)
    raw.rotation[:] *= np.linspace(0.5, 2, count, dtype=np.float32)[:, None]  # any length
    return raw


def target_of(pinhole=PINHOLE, seed: int = 5) -> Target:
    rng = np.random.default_rng(seed)
    shape = pinhole.height, pinhole.width
    return Target.of(rng.gamma(1, 0.5, (*shape, 3)).astype(np.float32), rng.uniform(size=shape) > 0.3, 0.5)


def optimiser_of(raw: RawGaussians, device: str) -> CudaOptimiser:
    return CudaOptimiser(raw, AdamState.zeros(raw), BLEND, device)


def twin_gradients(raw: RawGaussians, pinhole, target: Target) -> tuple[float, dict[str, np.ndarray]]:
    """Loss and its gradients by the raw parameters, of our own rasteriser's twin in double precision."""
    p = {name: torch.tensor(getattr(raw, name), dtype=torch.float64, requires_grad=True) for name in NAMES}
    rotation = torch.nn.functional.normalize(p["rotation"], dim=1)
    activated = p["position"], rotation, p["log_scale"].exp(), p["logit_opacity"].sigmoid(), p["sh"]
    image = torch_splat.splat(*activated, pinhole, BLEND)[0]
    loss = loss_of(image, target)
    loss.backward()
    return loss.item(), {name: tensor.grad.numpy() for name, tensor in p.items()}


def loss_of(image: torch.Tensor, target: Target) -> torch.Tensor:
    tone, valid = torch.from_numpy(target.tone / 65535), torch.from_numpy(target.valid)
    return cuda_loss.image_loss(image, tone, valid, target.tone_scale)


def assert_close(actual, expected, message: str = "", tolerance: float = TOLERANCE):
    np.testing.assert_allclose(actual, expected, tolerance, tolerance * np.abs(expected).max(), err_msg=message)


def bits(optimiser: CudaOptimiser) -> list[bytes]:
    adam = optimiser.adam
    groups = [getattr(group, name).tobytes() for group in (optimiser.raw, adam.mean, adam.square) for name in NAMES]
    return [*groups, adam.steps.tobytes()]


@pytest.mark.parametrize("degree", range(4))
def test_the_image_is_that_of_the_cpu(device, degree):
    raw = thin_gaussians(degree=degree)
    image = optimiser_of(raw, device).render(PINHOLE)
    assert (image.dtype, image.shape) == (np.float32, (40, 48, 3))
    assert_close(image, rasterise(raw.to_gaussians(), PINHOLE, BLEND))


def test_opaque_gaussians_differ_by_what_is_documented(device):
    gaussians = oracle.random_gaussians(100, 0, seed=3)
    gaussians = dataclasses.replace(gaussians, opacity=np.linspace(0.9, 1, 100, dtype=np.float32))
    raw = RawGaussians.from_gaussians(gaussians)
    expected, transmittance = splat_of(raw)
    difference = np.abs(optimiser_of(raw, device).render(PINHOLE) - expected)
    assert transmittance.min() < 1e-4  # pixels end
    brightest = oracle.colour(gaussians, PINHOLE).max()
    assert 1e-4 * brightest < difference.max() < 0.1 * brightest
    assert difference.mean() < 3e-4 * brightest


def splat_of(raw: RawGaussians) -> tuple[np.ndarray, np.ndarray]:
    g = raw.to_gaussians()
    tensors = (torch.from_numpy(a) for a in (g.position, g.rotation, g.scale, g.opacity, g.sh))
    return tuple(t.numpy() for t in splat(*tensors, PINHOLE, BLEND))


@pytest.mark.parametrize("degree", [0, 2])
def test_iterations_are_those_of_the_twin_and_numpys_adam(device, degree):
    raw = thin_gaussians(degree=degree)
    optimiser = optimiser_of(raw, device)
    mean, square = ({name: np.zeros(getattr(raw, name).shape) for name in NAMES} for _ in range(2))
    for iteration in range(1, 4):
        before, target = optimiser.raw, target_of(seed=iteration)
        value, gradients = twin_gradients(before, PINHOLE, target)
        loss, _ = optimiser.iterate(PINHOLE, target, RATES)
        assert loss == pytest.approx(value, rel=TOLERANCE)
        after, adam = optimiser.raw, optimiser.adam
        stepped = adam.steps == iteration
        assert stepped.sum() > 40
        for name in NAMES:
            mean[name] = ADAM_BETA1 * mean[name] + (1 - ADAM_BETA1) * gradients[name]
            square[name] = ADAM_BETA2 * square[name] + (1 - ADAM_BETA2) * gradients[name] ** 2
            assert_close(getattr(adam.mean, name), mean[name], f"mean of {name}")
            assert_close(getattr(adam.square, name), square[name], f"square of {name}")
            # From the optimiser's own moments: where a gradient nearly vanishes, only its rounding has a direction.
            root = np.sqrt(getattr(adam.square, name).astype(float) / (1 - ADAM_BETA2**iteration)) + 1e-15
            step = RATES[name] * getattr(adam.mean, name) / (1 - ADAM_BETA1**iteration) / root
            expected = getattr(before, name) - step
            if degree == 0 and name == "sh":
                expected = np.maximum(expected, 0)
            assert_close(getattr(after, name)[stepped], expected[stepped], name, 1e-5)


def test_each_gaussian_has_the_bias_correction_of_its_own_steps(device):
    raw = thin_gaussians()
    adam = AdamState.zeros(raw)
    adam.steps[:25] = 1000  # seen before, with gradients of zero
    optimiser = CudaOptimiser(raw, adam, BLEND, device)
    optimiser.iterate(PINHOLE, target_of(), RATES)
    moved = np.abs(optimiser.raw.sh - raw.sh)[:, 0].max(axis=1)
    steps = optimiser.adam.steps
    np.testing.assert_allclose(moved[steps == 1], RATES["sh"], rtol=TOLERANCE)
    ratio = 0.1 / np.sqrt(0.001 / (1 - ADAM_BETA2**1001))
    np.testing.assert_allclose(moved[steps == 1001], RATES["sh"] * ratio, rtol=TOLERANCE)
    assert min((steps == 1).sum(), (steps == 1001).sum()) > 10


def test_who_is_not_seen_keeps_its_bits(device):
    raw = thin_gaussians()
    raw.position[::2] += 100 * CAMERA.world_from_view[:3, 2].astype(np.float32)  # behind the eye
    optimiser = optimiser_of(raw, device)
    _, found = optimiser.iterate(PINHOLE, target_of(), RATES)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(optimiser.raw, name)[::2], getattr(raw, name)[::2])
        assert not getattr(optimiser.adam.mean, name)[::2].any()
    assert not optimiser.adam.steps[::2].any()
    assert optimiser.adam.steps[1::2].sum() > 20
    assert not any(statistic[::2].any() for statistic in found[:4])


def test_what_is_masked_out_moves_nothing(device):
    optimiser = optimiser_of(thin_gaussians(), device)
    before = bits(optimiser)
    nothing = Target.of(np.zeros((40, 48, 3), np.float32), np.zeros((40, 48), bool), 0.5)
    loss, found = optimiser.iterate(PINHOLE, nothing, RATES)
    assert loss == 0
    assert bits(optimiser) == before
    assert found.contribution.any()
    assert not found.error.any()


def test_contribution_and_error_equal_their_definition(device):
    raw, target = thin_gaussians(), target_of()
    _, found = optimiser_of(raw, device).iterate(PINHOLE, target, RATES)
    g = raw.to_gaussians()
    tensors = [torch.tensor(a, dtype=torch.float64) for a in (g.position, g.rotation, g.scale, g.opacity, g.sh)]
    tensors[4].requires_grad_()
    image, _ = torch_splat.splat(*tensors, PINHOLE, BLEND)
    error = torch.from_numpy(image_loss(image.detach().numpy(), target).error)
    for statistic, weight in ((found.contribution, torch.ones_like(error)), (found.error, error)):
        (by_sh,) = torch.autograd.grad((image[..., 0] * weight).sum(), tensors[4], retain_graph=True)
        assert statistic.dtype == np.float32
        assert_close(statistic, by_sh[:, 0, 0].numpy() / SH_C0)
    assert found.not_finite == -1


def test_the_radius_is_the_largest_standard_deviation(device):
    raw = thin_gaussians()
    _, found = optimiser_of(raw, device).iterate(PINHOLE, target_of(), RATES)
    projected = oracle.project(raw.to_gaussians(), PINHOLE, BLEND)
    seen = found.contribution > 0
    assert seen.sum() > 40
    expected = np.sqrt(np.linalg.eigvalsh(projected.cov2d).max(axis=1))
    np.testing.assert_allclose(found.radius[seen], expected[seen], rtol=1e-3)  # conics lose digits in needles
    assert not found.radius[~projected.drawn].any()


def test_the_gradient_by_the_mean_is_that_of_moving_the_image(device):
    """Of a lone Gaussian: moving the principal point moves its mean and nothing else."""
    values = ([[0.1, -0.1, -0.8]], [[0, 0, 0, 1]], [[0.2, 0.1, 0.1]], [0.8], [[[2, 1, 3]]])
    one, target = Gaussians(*(np.array(v, np.float32) for v in values)), target_of()
    _, found = optimiser_of(RawGaussians.from_gaussians(one), device).iterate(PINHOLE, target, RATES)

    tensors = [torch.tensor(v, dtype=torch.float64) for v in values]
    centre = [torch.tensor(c, dtype=torch.float64, requires_grad=True) for c in (PINHOLE.cx, PINHOLE.cy)]
    image, _ = torch_splat.splat(*tensors, PINHOLE._replace(cx=centre[0], cy=centre[1]), BLEND)
    slope = [s.item() for s in torch.autograd.grad(loss_of(image, target), centre)]
    assert found.mean2d_gradient[0] == pytest.approx(np.hypot(*slope), rel=TOLERANCE)
    assert np.hypot(*slope) > 1e-4


def test_colour_of_degree_0_stays_at_0_or_more(device):
    raw = thin_gaussians()
    raw.sh[:] = 0.01
    dark = Target.of(np.zeros((40, 48, 3), np.float32), np.ones((40, 48), bool), 0.5)
    optimiser = optimiser_of(raw, device)
    optimiser.iterate(PINHOLE, dark, RATES)
    assert optimiser.raw.sh.min() == 0


def test_the_loss_falls(device):
    truth = thin_gaussians()
    start = RawGaussians(*(getattr(truth, name).copy() for name in NAMES))
    start.sh[:] = 1.0
    target = Target.of(rasterise(truth.to_gaussians(), PINHOLE, BLEND), np.ones((40, 48), bool), 0.5)
    optimiser = optimiser_of(start, device)
    losses = [optimiser.iterate(PINHOLE, target, RATES)[0] for _ in range(20)]
    assert losses[-1] < losses[0] / 2


def test_what_goes_in_and_out_are_copies(device):
    raw = thin_gaussians()
    again = RawGaussians(*(getattr(raw, name).copy() for name in NAMES))
    optimiser = optimiser_of(raw, device)
    raw.position[:] = np.nan
    optimiser.raw.position[:] = np.nan
    assert bits(optimiser) == bits(optimiser_of(again, device))


def test_none_and_small_images_work(device):
    empty = thin_gaussians(0)
    optimiser = optimiser_of(empty, device)
    loss, found = optimiser.iterate(PINHOLE, target_of(), RATES)
    assert loss == pytest.approx(image_loss(np.zeros((40, 48, 3)), target_of()).value)
    assert [len(s) for s in found[:4]] == [0] * 4
    assert not optimiser.render(PINHOLE).any()
    small, optimiser = CAMERA.pinhole(5, 3), optimiser_of(thin_gaussians(), device)
    image = optimiser.render(small)
    expected = image_loss(image.astype(float), target_of(small))
    assert optimiser.iterate(small, target_of(small), RATES)[0] == pytest.approx(expected.value, rel=1e-5)


def test_what_is_not_finite_stops_before_the_step(device, monkeypatch):
    raw = thin_gaussians()
    raw.sh[7] = np.nan
    optimiser = optimiser_of(raw, device)
    before = bits(optimiser)
    with pytest.raises(FloatingPointError, match="loss"):
        optimiser.iterate(PINHOLE, target_of(), RATES)
    assert bits(optimiser) == before
    # A loss that is finite, and whose gradient is 0 times infinity.
    monkeypatch.setattr(cuda_loss, "image_loss", lambda image, *_: (0 * image).sqrt().sum())
    optimiser = optimiser_of(thin_gaussians(), device)
    before = bits(optimiser)
    with pytest.raises(FloatingPointError, match=r"Gaussian \d+"):
        optimiser.iterate(PINHOLE, target_of(), RATES)
    assert bits(optimiser) == before


def test_other_values_of_alpha_min_are_refused(device):
    optimiser = CudaOptimiser(
        thin_gaussians(), AdamState.zeros(thin_gaussians()), OverBlend(0.01, alpha_min=0.01), device
    )
    with pytest.raises(AssertionError, match="alpha_min"):
        optimiser.render(PINHOLE)


def test_the_reason_says_what_is_missing(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert unavailable() == "torch finds no CUDA device"
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(cuda_splat, "find_spec", lambda name: None)
    assert "extra 'cuda'" in unavailable()
    monkeypatch.setattr(cuda_splat, "find_spec", lambda name: None if name == "gsplat.csrc" else name)
    monkeypatch.setattr("torch.utils.cpp_extension.CUDA_HOME", None)
    assert "nvcc" in unavailable()
    monkeypatch.setattr("torch.utils.cpp_extension.CUDA_HOME", "/usr/local/cuda")
    assert unavailable() is None


def test_the_optimiser_is_the_one_that_can_run_here(monkeypatch):
    assert optimiser_class() is (CudaOptimiser if unavailable() is None else CpuOptimiser)
    monkeypatch.setattr("gsgi.baker.over.optimiser.find_spec", lambda name: name)
    for reason, expected in (("no device", CpuOptimiser), (None, CudaOptimiser)):
        monkeypatch.setattr(cuda_splat, "unavailable", lambda reason=reason: reason)
        assert optimiser_class() is expected


def test_the_choice_loads_no_torch_where_there_is_no_gsplat():
    """Torch takes seconds to import."""
    code = "import sys; sys.modules['gsplat'] = None; " if NO_CUDA is None else "import sys; "
    code += "from gsgi.baker.over.optimiser import optimiser_class; optimiser_class(); print('torch' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
