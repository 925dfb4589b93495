"""Milliseconds of one iteration of the fit, by the number of Gaussians."""

import time

import numpy as np
import torch

from gsgi.baker.loss import image_loss, ssim
from gsgi.baker.raw_gaussians import RawGaussians
from gsgi.baker.trainer import AdamState, Workspace
from gsgi.runtime.camera import Pinhole, look_at
from gsgi.runtime.gaussians import Blend, Gaussians

SIZES = ((10_000, 512, 512), (50_000, 512, 512), (200_000, 512, 512), (200_000, 960, 540))
REPEATS = 12
BLEND = Blend(near=0.01)
YFOV = 1.57  # rad; half of the box is in view, and 15 M pairs are blended where that trainer counted 15.4 M
RATES = {"position": 1e-5, "rotation": 1e-4, "log_scale": 1e-4, "logit_opacity": 1e-4, "sh": 1e-4}
# ms that a well-known trainer on libtorch took for an iteration of this size.
OTHERS = {(10_000, 512): 134, (50_000, 512): 305, (200_000, 512): 726, (200_000, 960): 1068}


def fit() -> list[dict]:
    """Milliseconds of one iteration, the least of a few: forward with activation, SSIM and L1, backward with Adam."""
    return [_measure(count, width, height) for count, width, height in SIZES]


def _measure(count: int, width: int, height: int) -> dict:
    pinhole = _camera().pinhole(width, height)
    raw = RawGaussians.from_gaussians(_walls(count, pinhole))
    adam, workspace = AdamState.zeros(raw), Workspace()
    target = torch.rand(height, width, 3, generator=torch.Generator().manual_seed(0))
    valid = torch.ones(height, width, dtype=torch.bool)
    times = {"forward": [], "loss": [], "backward": [], "torch_ssim": []}
    for _ in range(REPEATS):
        start = time.perf_counter()
        image, _ = workspace.forward(raw, pinhole, BLEND)
        drawn = time.perf_counter()
        shown = torch.from_numpy(image).requires_grad_()
        image_loss(shown, target, valid, 0.5).backward()
        by_image = shown.grad.numpy()
        compared = time.perf_counter()
        workspace.step(raw, adam, by_image, RATES)
        stepped = time.perf_counter()
        shown = torch.from_numpy(image).requires_grad_()
        ssim(shown, target).backward()
        end = time.perf_counter()
        for name, seconds in zip(times, np.diff([start, drawn, compared, stepped, end]), strict=True):
            times[name].append(1e3 * seconds)
    best = {name: min(values) for name, values in times.items()}
    kernels = best["forward"] + best["backward"]
    iteration = kernels + best["loss"]
    return {
        "gaussians": count, "width": width, "height": height,
        "forward_ms": round(best["forward"], 2), "backward_ms": round(best["backward"], 2),
        "iteration_ms": round(iteration, 2), "torch_ssim_ms": round(best["torch_ssim"], 2),
        "ns_per_pair": round(1e6 * kernels / workspace.pair_count, 2), "pairs": workspace.pair_count,
        "loss_ms": round(best["loss"], 2), "times_faster": round(OTHERS[count, width] / iteration, 1),
    }  # fmt: skip


def _camera():
    return look_at(np.array([0.3, 0.1, 0.45]), np.array([-0.3, -0.1, -0.5]), np.array([0.0, 1.0, 0.0]), YFOV, 0.01)


def _walls(count: int, pinhole: Pinhole) -> Gaussians:
    """Flat Gaussians on the walls of a unit box; three standard deviations are 6 to 10 px in the image."""
    rng = np.random.default_rng(0)
    axis, side = rng.integers(3, size=count), rng.choice([-0.5, 0.5], count)
    position = rng.uniform(-0.5, 0.5, (count, 3))
    position[np.arange(count), axis] = side
    distance = np.linalg.norm(position - _camera().position, axis=1)
    scale = np.tile((rng.uniform(6, 10, count) / 3 * distance / pinhole.fy)[:, None], 3)
    scale[np.arange(count), axis] *= 0.1
    rotation = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    opacity, sh = rng.uniform(0.5, 0.9, count), rng.uniform(0.5, 3, (count, 1, 3))
    return Gaussians(*(a.astype(np.float32) for a in (position, rotation, scale, opacity, sh)))
