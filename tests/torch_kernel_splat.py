"""The `over` operator as a differentiable torch function, computed by the CPU kernel."""

import torch
from torch import Tensor

from gsgi.baker.native import kernels
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend


def splat(
    position: Tensor,
    rotation: Tensor,
    scale: Tensor,
    opacity: Tensor,
    sh: Tensor,
    pinhole: Pinhole,
    blend: OverBlend,
) -> tuple[Tensor, Tensor]:
    """Image (H, W, 3) of linear radiance and transmittance (H, W) in [0, 1] of N Gaussians, blended front to back.

    Both outputs are differentiable in all five tensors. The result has the same bits for any number of threads, and is
    finite for finite input.

    position (N, 3) m, world space; rotation (N, 4) unit quaternions xyzw, not normalised here; scale (N, 3) m, linear
    standard deviations; opacity (N,) in [0, 1]; sh (N, K, 3), K in 1, 4, 9, 16. All float32 or all float64, on the CPU;
    anything else raises TypeError.

    Kerbl et al. 2023; Zwicker et al. 2002, "EWA Splatting".
    """
    return _Splat.apply(position, rotation, scale, opacity, sh, pinhole, blend)


class _Splat(torch.autograd.Function):
    @staticmethod
    def forward(ctx, position, rotation, scale, opacity, sh, pinhole, blend):
        parameters = [t.detach().contiguous() for t in (position, rotation, scale, opacity, sh)]
        image, transmittance, frame = kernels.splat(*(t.numpy() for t in parameters), pinhole, blend)
        if any(ctx.needs_input_grad):
            ctx.frame = frame
            ctx.save_for_backward(*parameters)
        return torch.from_numpy(image), torch.from_numpy(transmittance)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_image, by_transmittance):
        arrays = (t.contiguous().numpy() for t in (*ctx.saved_tensors, by_image, by_transmittance))
        gradients = kernels.splat_backward(ctx.frame, *arrays)
        return *(torch.from_numpy(g) for g in gradients), None, None
