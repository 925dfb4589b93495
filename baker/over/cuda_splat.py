"""Differentiable rasterisation on a GPU: gsplat (Ye et al. 2025) behind the conventions of `rasterise.py`.

gsplat 1.5.3 differs from the CPU rasteriser in three places. The differences are given as weights, by which colours are
multiplied.

- It caps alpha at 0.999, not at `blend.alpha_max`. For a cap of 0.99 the difference is up to 0.009, within 0.14
  standard deviations of the centre of a Gaussian whose opacity is above the cap.
- It stops a pixel before the Gaussian that takes its transmittance to TRANSMITTANCE_MIN, not after it. This loses up to
  1e-4 / (1 - alpha) of the light: 0.01 for an alpha of 0.99, 0.1 for one of 0.999.
- It measures FRUSTUM_CLAMP from the edges of the image, not from the principal point. The two agree if that is central.

Its order of summation varies, so that two runs differ in the last bits.
"""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from gsgi.runtime import constants
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend

from .cuda_sh import sh_basis

# From our view space (y up, looking along -z) to OpenCV's (y down, looking along z).
OPENCV_FROM_VIEW = np.diag([1.0, -1.0, -1.0, 1.0])


class Drawn(NamedTuple):
    """An image of N Gaussians and its intermediate results; all tensors are on the device of the Gaussians."""

    image: Tensor  # (H, W, 3 + D), differentiable by the parameters, `channels` and `mean2d`
    channels: Tensor  # (N, 3 + D): the colour and D channels of zeros
    mean2d: Tensor  # (1, N, 2), px; undefined for Gaussians that were not drawn
    radius: Tensor  # (N,), px, largest standard deviation in the image; 0 for Gaussians that were not drawn


def unavailable() -> str | None:
    """Reason why gsplat cannot draw on this machine, or None if it can. Compiles nothing."""
    if not torch.cuda.is_available():
        return "torch finds no CUDA device"
    if find_spec("gsplat") is None:
        return "gsplat is not installed: install gsgi with its extra 'cuda'"
    from torch.utils.cpp_extension import CUDA_HOME

    if find_spec("gsplat.csrc") is None and CUDA_HOME is None:
        return "gsplat comes without kernels and finds no CUDA toolkit (nvcc) to compile them"
    return None


def draw(raw: Mapping[str, Tensor], pinhole: Pinhole, blend: OverBlend, extra_channels: int = 0) -> Drawn:
    """Draw Gaussians given by the five float32 tensors of RawGaussians.

    `extra_channels` is D of Drawn. These channels of zeros change no other gradient. Their own gradient is, for each
    Gaussian, the sum over the pixels of transmittance * alpha * the gradient with respect to that channel of the image.
    `blend.alpha_min` must be 1/255, which is built into gsplat. The first call on a machine may compile gsplat, which
    takes minutes.
    """
    assert blend.alpha_min == constants.ALPHA_MIN, blend
    colour = _colour(raw["position"], raw["sh"], pinhole)
    channels = torch.cat([colour, colour.new_zeros(len(colour), extra_channels)], dim=1)
    if not len(colour):  # gsplat divides by the number of Gaussians
        image = channels.sum() + colour.new_zeros(pinhole.height, pinhole.width, channels.shape[1])
        return Drawn(image, channels, raw["position"][None, :, :2], colour.new_zeros(0))
    from gsplat import rasterization

    images, _, meta = rasterization(
        means=raw["position"],
        quats=raw["rotation"][:, [3, 0, 1, 2]],  # wxyz; normalised by gsplat
        scales=raw["log_scale"].exp(),
        opacities=raw["logit_opacity"].sigmoid(),
        colors=channels,
        viewmats=colour.new_tensor(OPENCV_FROM_VIEW @ pinhole.view_from_world)[None],
        Ks=colour.new_tensor([[pinhole.fx, 0, pinhole.cx], [0, pinhole.fy, pinhole.cy], [0, 0, 1]])[None],
        width=pinhole.width,
        height=pinhole.height,
        near_plane=blend.near,
        eps2d=blend.dilation,
        packed=False,
    )
    drawn = (meta["radii"][0] > 0).all(dim=1)
    return Drawn(images[0], channels, meta["means2d"], torch.where(drawn, _radius(meta["conics"][0]), 0))


def _colour(position: Tensor, sh: Tensor, pinhole: Pinhole) -> Tensor:
    """Linear radiance (N, 3) towards the camera, 0 or more."""
    eye = position.new_tensor(np.linalg.inv(pinhole.view_from_world)[:3, 3])
    direction = torch.nn.functional.normalize(position - eye, dim=1)
    colour = torch.einsum("nk,nkc->nc", sh_basis(direction, sh.shape[1]), sh)
    return torch.where(colour < 0, 0, colour)  # black can grow: it has a gradient, which clamp() does not give it


def _radius(conic: Tensor) -> Tensor:
    """Largest standard deviation (N,) of inverse covariances (N, 3): xx, xy, yy.

    Computed in double precision. The determinant is at least 1e-7 xx yy: in single precision the conic of a needle does
    not resolve smaller ones.
    """
    a, b, c = conic.detach().double().unbind(dim=1)
    determinant = torch.maximum(a * c - b * b, 1e-7 * a * c)
    half_trace, half_difference = (a + c) / 2, (a - c) / 2
    return ((half_trace + torch.hypot(half_difference, b)) / determinant).sqrt().float()
