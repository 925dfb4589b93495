"""One iteration of the fit on a GPU: `CudaOptimiser` does with gsplat and torch what `CpuOptimiser` does in C++."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from gsgi.baker.fitting.target import INVALID, Target
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.constants import ADAM_BETA1, ADAM_BETA2, ADAM_EPSILON
from gsgi.runtime.gaussians import OverBlend

from . import cuda_loss
from .cuda_splat import draw
from .raw_gaussians import NAMES, RawGaussians
from .workspace import AdamState, StepStatistics


class CudaOptimiser:
    """Gaussians that are fitted to targets one view at a time; they and Adam's state stay on the GPU.

    Adam is implemented here because torch's version loads Triton, whose LLVM crashes a process in which Mesa has drawn
    with its own LLVM.
    """

    def __init__(self, raw: RawGaussians, adam: AdamState, blend: OverBlend, device: str = "cuda"):
        self._blend, self._device = blend, device
        self._raw, self._mean, self._square = (self._upload(group) for group in (raw, adam.mean, adam.square))
        self._steps = torch.tensor(adam.steps, device=device)

    @property
    def raw(self) -> RawGaussians:
        """Copies of the current parameters."""
        return _download(self._raw)

    @property
    def adam(self) -> AdamState:
        """Copy of Adam's state."""
        return AdamState(_download(self._mean), _download(self._square), _numpy(self._steps))

    def render(self, pinhole: Pinhole) -> np.ndarray:
        """Image (H, W, 3) float32 of linear radiance."""
        return _numpy(draw(self._raw, pinhole, self._blend).image)

    def iterate(self, pinhole: Pinhole, target: Target, rates: Mapping[str, float]) -> tuple[float, StepStatistics]:
        """Take one step of Adam on the loss against `target`; return the loss before the step and its statistics.

        `rates` maps each name of RawGaussians to a step size. Only Gaussians whose gradient is not all zero are
        stepped, each with the bias correction of its own number of steps. At SH degree 0, `sh` is kept at 0 or more:
        the image clamps negative colours, so that they would get no gradient. Raises FloatingPointError where the loss
        or the gradient of a Gaussian is not finite; nothing is stepped then.
        """
        parameters = {name: tensor.detach().requires_grad_() for name, tensor in self._raw.items()}
        drawn = draw(parameters, pinhole, self._blend, extra_channels=2)
        loss, by_image, error = self._loss(drawn.image[..., :3].detach(), target)
        # The gradients of the two black channels are each Gaussian's weight and its weight times the error.
        by_channels = torch.cat([by_image, torch.ones_like(error)[..., None], error[..., None]], dim=2)
        inputs = (*parameters.values(), drawn.channels, drawn.mean2d)
        # Without any Gaussian the image depends on no parameter; the zero gradients are materialised.
        *found, weights, by_mean2d = torch.autograd.grad(drawn.image, inputs, by_channels, materialize_grads=True)
        gradients = dict(zip(parameters, found, strict=True))
        _check_finite(gradients)
        self._step(gradients, rates)
        by_mean2d = torch.where(drawn.radius > 0, by_mean2d[0].norm(dim=1), 0)
        statistics = (weights[:, 3], weights[:, 4], drawn.radius, by_mean2d)
        return loss, StepStatistics(*(_numpy(s) for s in statistics), not_finite=-1)

    def _loss(self, image: Tensor, target: Target) -> tuple[float, Tensor, Tensor]:
        """Loss of an image (H, W, 3), its gradient with respect to the image, and the loss per pixel (H, W)."""
        tone = torch.tensor(target.tone.astype(np.int32), device=self._device)
        arguments = tone.double() / INVALID, tone[..., 0] != INVALID, target.tone_scale
        image = image.double().requires_grad_()
        loss = cuda_loss.image_loss(image, *arguments)
        if not loss.isfinite():
            raise FloatingPointError(f"the loss is {loss.item()}")
        (by_image,) = torch.autograd.grad(loss, image)
        return loss.item(), by_image.float(), cuda_loss.error(image.detach(), *arguments).float()

    @torch.no_grad()
    def _step(self, gradients: Mapping[str, Tensor], rates: Mapping[str, float]) -> None:
        """Apply Adam (Kingma and Ba 2015), in double precision, to the Gaussians that have a gradient."""
        moved = torch.stack([g.any(dim=1) for g in _columns(gradients)]).any(dim=0)
        self._steps[moved] += 1
        bias1, bias2 = (1 - beta ** self._steps[moved].double() for beta in (ADAM_BETA1, ADAM_BETA2))
        for name, gradient in gradients.items():
            per_gaussian = (-1, *[1] * (gradient.ndim - 1))
            g = gradient[moved].double()
            mean = ADAM_BETA1 * self._mean[name][moved] + (1 - ADAM_BETA1) * g
            square = ADAM_BETA2 * self._square[name][moved] + (1 - ADAM_BETA2) * g * g
            root = (square / bias2.view(per_gaussian)).sqrt() + ADAM_EPSILON
            step = rates[name] * mean / bias1.view(per_gaussian) / root
            self._mean[name][moved], self._square[name][moved] = mean.float(), square.float()
            self._raw[name][moved] -= step.float()
        if self._raw["sh"].shape[1] == 1:
            self._raw["sh"].clamp_(min=0)

    def _upload(self, group: RawGaussians) -> dict[str, Tensor]:
        return {name: torch.tensor(getattr(group, name), device=self._device) for name in NAMES}


def _download(tensors: Mapping[str, Tensor]) -> RawGaussians:
    return RawGaussians(*(_numpy(tensors[name]) for name in NAMES))


def _numpy(tensor: Tensor) -> np.ndarray:
    return tensor.cpu().numpy().copy()  # .cpu() does not copy a tensor on the CPU


def _columns(gradients: Mapping[str, Tensor]) -> list[Tensor]:
    """The gradients as matrices with one row per Gaussian."""
    return [g.unsqueeze(-1).flatten(start_dim=1) for g in gradients.values()]


def _check_finite(gradients: Mapping[str, Tensor]) -> None:
    finite = torch.stack([g.isfinite().all(dim=1) for g in _columns(gradients)]).all(dim=0)
    if not finite.all():
        raise FloatingPointError(f"the gradient of Gaussian {int((~finite).nonzero()[0])} is not finite")
