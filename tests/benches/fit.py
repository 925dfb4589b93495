"""Milliseconds of one iteration of the `over` fit, by the number of Gaussians."""

import time
from collections.abc import Callable

import numpy as np
import torch

from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import INVALID, Target
from gsgi.baker.over import cuda_loss
from gsgi.baker.over.optimiser import CpuOptimiser
from gsgi.baker.over.raw_gaussians import RawGaussians
from gsgi.baker.over.workspace import AdamState, Workspace
from gsgi.runtime.camera import Pinhole, look_at
from gsgi.runtime.gaussians import Gaussians, OverBlend

SIZES = ((10_000, 512, 512), (50_000, 512, 512), (200_000, 512, 512), (200_000, 960, 540))
REPEATS = 20
BLEND = OverBlend(near=0.01)
YFOV = 1.57  # rad; half of the box is in view, and 15 M pairs are blended (15.4 M in the trainer below)
RATES = {"position": 1e-5, "rotation": 1e-4, "log_scale": 1e-4, "logit_opacity": 1e-4, "sh": 1e-4}
TONE_SCALE = 0.5  # radiance
# ms per iteration of a well-known trainer on libtorch, by the number of Gaussians and the width.
LIBTORCH = {(10_000, 512): 134, (50_000, 512): 305, (200_000, 512): 726, (200_000, 960): 1068}


def fit() -> list[dict]:
    """Milliseconds of one iteration as the fit runs it, of its parts, and of SSIM and L1 in torch; minimum of 20."""
    return [_measure(count, width, height) for count, width, height in SIZES]


def _measure(count: int, width: int, height: int) -> dict:
    pinhole = _camera().pinhole(width, height)
    raw = RawGaussians.from_gaussians(_walls(count, pinhole))
    light = np.random.default_rng(0).uniform(0, 2, (height, width, 3)).astype(np.float32)
    target = Target.of(light, np.ones((height, width), bool), TONE_SCALE)
    optimiser = CpuOptimiser(raw, AdamState.zeros(raw), BLEND)
    workspace, adam = Workspace(), AdamState.zeros(raw)
    best: dict[str, float] = {}
    for _ in range(REPEATS):
        _time(best, "iteration", lambda: optimiser.iterate(pinhole, target, RATES))
        image, _ = _time(best, "forward", lambda: workspace.forward(raw, pinhole, BLEND))
        loss = _time(best, "loss", lambda image=image: image_loss(image, target))
        _time(best, "backward", lambda loss=loss: workspace.step(raw, adam, loss.by_image, RATES, loss.error))
    for _ in range(REPEATS):  # in a loop of its own, because torch's threads keep spinning for a while
        _time(best, "torch_ssim", lambda: _torch_loss(image, target))
    parts = {name: best[name] for name in ("forward", "loss", "backward")}
    return {
        "gaussians": count, "width": width, "height": height,
        **{f"{name}_ms": round(best[name], 2) for name in ("forward", "backward", "iteration", "torch_ssim", "loss")},
        "ns_per_pair": round(1e6 * (best["forward"] + best["backward"]) / workspace.pair_count, 2),
        "pairs": workspace.pair_count,
        **{f"{name}_share": round(part / sum(parts.values()), 2) for name, part in parts.items()},
        "workspace_MB": round(workspace.byte_count / 1e6, 1),
        "times_faster": round(LIBTORCH[count, width] / best["iteration"], 1),
    }  # fmt: skip


def _time(best: dict[str, float], name: str, call: Callable):
    """Return what a call returns, and keep the least milliseconds under `name`."""
    start = time.perf_counter()
    result = call()
    best[name] = min(best.get(name, np.inf), 1e3 * (time.perf_counter() - start))
    return result


def _torch_loss(image: np.ndarray, target: Target) -> None:
    shown = torch.from_numpy(image).requires_grad_()
    tone = torch.from_numpy(target.tone / np.float32(INVALID))
    cuda_loss.image_loss(shown, tone, torch.from_numpy(target.valid), TONE_SCALE).backward()


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
