"""One iteration of the fit on a GPU: `CudaOptimiser` does with gsplat and torch what `CpuOptimiser` does in C++."""

import math
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

    The parameters of N Gaussians are the rows of one matrix (N, P), the columns of NAMES side by side. Launching a
    kernel takes longer than stepping thousands of Gaussians in it, so a step is a few kernels over the whole matrix.
    They make no list of the Gaussians that move: the host would have to wait for its length.

    Adam is implemented here because torch's version loads Triton, whose LLVM crashes a process in which Mesa has drawn
    with its own LLVM.
    """

    def __init__(self, raw: RawGaussians, adam: AdamState, blend: OverBlend, device: str = "cuda"):
        self._blend, self._device = blend, device
        self._shapes = [getattr(raw, name).shape[1:] for name in NAMES]
        self._widths = [math.prod(shape) for shape in self._shapes]
        self._raw, self._mean, self._square = (self._upload(group) for group in (raw, adam.mean, adam.square))
        self._steps = torch.tensor(adam.steps, device=device)

    @property
    def raw(self) -> RawGaussians:
        """Copies of the current parameters."""
        return self._download(self._raw)

    @property
    def adam(self) -> AdamState:
        """Copy of Adam's state."""
        return AdamState(self._download(self._mean), self._download(self._square), _numpy(self._steps))

    def render(self, pinhole: Pinhole) -> np.ndarray:
        """Image (H, W, 3) float32 of linear radiance."""
        return _numpy(draw(self._by_name(self._raw), pinhole, self._blend).image)

    def iterate(self, pinhole: Pinhole, target: Target, rates: Mapping[str, float]) -> tuple[float, StepStatistics]:
        """Take one step of Adam on the loss against `target`; return the loss before the step and its statistics.

        `rates` maps each name of RawGaussians to a step size. Only Gaussians whose gradient is not all zero are
        stepped, each with the bias correction of its own number of steps. At SH degree 0, `sh` is kept at 0 or more:
        the image clamps negative colours, so that they would get no gradient. Raises FloatingPointError where the loss
        or the gradient of a Gaussian is not finite; nothing is stepped then.
        """
        parameters = self._raw.detach().requires_grad_()
        drawn = draw(self._by_name(parameters), pinhole, self._blend, extra_channels=2)
        loss, by_image, error = self._loss(drawn.image[..., :3].detach(), target)
        # The gradients of the two black channels are each Gaussian's weight and its weight times the error.
        by_channels = torch.cat([by_image, torch.ones_like(error)[..., None], error[..., None]], dim=2)
        inputs = parameters, drawn.channels, drawn.mean2d
        # Without any Gaussian the image depends on no parameter; the zero gradients are materialised.
        gradient, weights, by_mean2d = torch.autograd.grad(drawn.image, inputs, by_channels, materialize_grads=True)
        _check_finite(gradient)
        self._step(gradient, rates)
        by_mean2d = torch.where(drawn.radius > 0, by_mean2d[0].norm(dim=1), 0)
        statistics = torch.stack([weights[:, 3], weights[:, 4], drawn.radius, by_mean2d])
        return loss, StepStatistics(*_numpy(statistics), not_finite=-1)

    def _loss(self, image: Tensor, target: Target) -> tuple[float, Tensor, Tensor]:
        """Loss of an image (H, W, 3), its gradient with respect to the image, and the loss per pixel (H, W)."""
        tone = torch.tensor(target.tone.astype(np.int32), device=self._device)
        arguments = tone.double() / INVALID, tone[..., 0] != INVALID, target.tone_scale
        image = image.double().requires_grad_()
        loss = cuda_loss.image_loss(image, *arguments)
        value = loss.item()
        if not math.isfinite(value):
            raise FloatingPointError(f"the loss is {value}")
        (by_image,) = torch.autograd.grad(loss, image)
        return value, by_image.float(), cuda_loss.error(image.detach(), *arguments).float()

    @torch.no_grad()
    def _step(self, gradient: Tensor, rates: Mapping[str, float]) -> None:
        """Apply Adam (Kingma and Ba 2015), in double precision, to the rows (N, P) of `gradient` that are not zero."""
        moved = gradient.any(dim=1, keepdim=True)
        self._steps += moved[:, 0]
        bias1, bias2 = (1 - beta ** self._steps.double()[:, None] for beta in (ADAM_BETA1, ADAM_BETA2))
        g = gradient.double()
        mean = ADAM_BETA1 * self._mean + (1 - ADAM_BETA1) * g
        square = ADAM_BETA2 * self._square + (1 - ADAM_BETA2) * g * g
        rate = [rates[name] for name, width in zip(NAMES, self._widths, strict=True) for _ in range(width)]
        # Rows that have never moved divide by a bias of 0 here, and are left as they are below.
        step = g.new_tensor(rate) * mean / bias1 / ((square / bias2).sqrt() + ADAM_EPSILON)
        self._mean = torch.where(moved, mean.float(), self._mean)
        self._square = torch.where(moved, square.float(), self._square)
        self._raw = torch.where(moved, self._raw - step.float(), self._raw)
        sh = self._by_name(self._raw)["sh"]
        if sh.shape[1] == 1:
            sh.clamp_(min=0)

    def _by_name(self, matrix: Tensor) -> dict[str, Tensor]:
        """The columns of a matrix (N, P) as tensors of the shapes of RawGaussians, by name."""
        columns = zip(NAMES, matrix.split(self._widths, dim=1), self._shapes, strict=True)
        return {name: part.view(len(matrix), *shape) for name, part, shape in columns}

    def _upload(self, group: RawGaussians) -> Tensor:
        columns = [getattr(group, name).reshape(len(group), w) for name, w in zip(NAMES, self._widths, strict=True)]
        return torch.tensor(np.concatenate(columns, axis=1), device=self._device)

    def _download(self, matrix: Tensor) -> RawGaussians:
        tensors = self._by_name(matrix.cpu())
        return RawGaussians(*(tensors[name].numpy().copy() for name in NAMES))


def _numpy(tensor: Tensor) -> np.ndarray:
    return tensor.cpu().numpy().copy()  # .cpu() does not copy a tensor on the CPU


def _check_finite(gradient: Tensor) -> None:
    finite = gradient.isfinite().all(dim=1)
    if not finite.all():
        raise FloatingPointError(f"the gradient of Gaussian {int((~finite).nonzero()[0])} is not finite")
