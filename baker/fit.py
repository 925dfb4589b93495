"""Fits Gaussians to views of B: rasterise, compare, step (Kerbl et al. 2023)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from gsgi.runtime.camera import Camera
from gsgi.runtime.gaussians import Blend, Gaussians

from .adam import Adam
from .checkpoint import Checkpoint
from .loss import image_loss
from .splat import splat
from .target import Target

# Adam's steps per parameter; lengths in units of the mean scale, light in units of the tone scale. They fall to
# RATE_END of themselves, exponentially.
RATES = {"position": 0.03, "log_scale": 0.05, "rotation": 0.004, "logit_opacity": 0.05, "sh": 0.02}
RATE_END = 0.1
OPACITY_RANGE = (1e-4, 1 - 1e-4)  # what a logit can hold without vanishing gradients


@dataclass(frozen=True)
class View:
    """One image to fit: B (H, W, 3) float32 linear, and which pixels (H, W) show a surface that has a B."""

    camera: Camera
    indirect: np.ndarray
    valid: np.ndarray


def fit(
    start: Gaussians,
    views: Sequence[View],
    blend: Blend,
    tone_scale: float,
    iterations: int,
    seed: int,
    advance: Callable[..., None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Gaussians:
    """Gaussians whose images match the views, from `start`, by Adam on 0.2 L1 + 0.8 D-SSIM, one view per iteration.

    `tone_scale` is in radiance. `advance(1, note)` is called after each iteration. Goes on from `checkpoint` where it
    holds a state and keeps states there. Deterministic for a seed, whatever the number of threads, and wherever it was
    interrupted. Raises FloatingPointError at the first loss that is not finite, naming iteration and view.
    """
    parameters = _raw(start)
    unit = {"position": float(start.scale.mean()) if len(start) else 0.0, "sh": tone_scale}
    adam = Adam(parameters, {name: rate * unit.get(name, 1.0) for name, rate in RATES.items()})
    targets = [Target.of(v.indirect, v.valid, tone_scale) for v in views]
    pinholes = [v.camera.pinhole(v.indirect.shape[1], v.indirect.shape[0]) for v in views]
    smoothed = None
    if checkpoint and (state := checkpoint.load()):
        adam.restore(state)
        if advance:
            advance(adam.steps, "from a checkpoint")
    for iteration, k in list(enumerate(_order(len(views), iterations, seed)))[adam.steps :]:
        image, _ = splat(*_activated(parameters), pinholes[k], blend)
        loss = image_loss(image.detach().numpy(), targets[k])
        if not np.isfinite(loss.value):
            raise FloatingPointError(f"the loss is {loss.value} at iteration {iteration}, view {k}")
        image.backward(torch.from_numpy(loss.by_image))
        adam.step(RATE_END ** (iteration / iterations))
        smoothed = loss.value if smoothed is None else 0.98 * smoothed + 0.02 * loss.value
        if advance:
            advance(1, f"loss {smoothed:.4f}")
        if checkpoint and checkpoint.due():
            checkpoint.save(adam.state())
    return _record(parameters)


def _order(views: int, iterations: int, seed: int) -> list[int]:
    """View of each iteration: every view once in each round, in shuffled order."""
    rng = np.random.default_rng(seed)
    rounds = [rng.permutation(views) for _ in range(-(-iterations // views))]
    return np.concatenate([np.empty(0, int), *rounds])[:iterations].tolist()


def _raw(gaussians: Gaussians) -> dict[str, torch.Tensor]:
    """The optimiser's parameters: values before activation."""
    opacity = torch.from_numpy(gaussians.opacity).clamp(*OPACITY_RANGE)
    values = {
        "position": torch.from_numpy(gaussians.position),
        "rotation": torch.from_numpy(gaussians.rotation),
        "log_scale": torch.from_numpy(gaussians.scale).clamp(min=1e-12).log(),
        "logit_opacity": torch.logit(opacity),
        "sh": torch.from_numpy(gaussians.sh),
    }
    return {name: value.clone().requires_grad_() for name, value in values.items()}


def _activated(raw: dict[str, torch.Tensor]) -> tuple[torch.Tensor, ...]:
    """position, rotation, scale, opacity, sh as the rasteriser takes them."""
    rotation = torch.nn.functional.normalize(raw["rotation"], dim=1)
    return raw["position"], rotation, raw["log_scale"].exp(), raw["logit_opacity"].sigmoid(), raw["sh"]


def _record(raw: dict[str, torch.Tensor]) -> Gaussians:
    with torch.no_grad():
        return Gaussians(*(tensor.detach().numpy().copy() for tensor in _activated(raw)))
