"""The kernel in plain torch: a few lines, all pixels at once, gradients by autograd."""

import torch
from torch import Tensor

from gsgi.baker.over.cuda_sh import sh_basis
from gsgi.runtime import constants as c
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import OverBlend


def splat(
    position: Tensor,  # (N, 3) m
    rotation: Tensor,  # (N, 4) xyzw
    scale: Tensor,  # (N, 3) m
    opacity: Tensor,  # (N,)
    sh: Tensor,  # (N, K, 3)
    pinhole: Pinhole,
    blend: OverBlend,
) -> tuple[Tensor, Tensor]:
    """Image (H, W, 3) and transmittance (H, W). Takes about ten floats of memory per pixel and Gaussian."""
    view_from_world = torch.as_tensor(pinhole.view_from_world, dtype=position.dtype)
    lens = view_from_world[:3, :3], pinhole, blend
    view = position @ view_from_world[:3, :3].T + view_from_world[:3, 3]  # (N, 3)
    depth = -view[:, 2]
    order = torch.argsort(depth, stable=True)
    order = order[(depth[order] >= blend.near) & (depth[order] > 0)]
    with torch.no_grad():  # dropped before the gradient, where 0 times infinity would be NaN
        order = order[_is_drawn(*_project(view[order], rotation[order], scale[order], *lens))]
    mean2d, axes = _project(view[order], rotation[order], scale[order], *lens)
    opacity = opacity[order]
    eye = torch.linalg.inv(view_from_world)[:3, 3]
    direction = torch.nn.functional.normalize(position[order] - eye, dim=1)
    colour = torch.einsum("nk,nkc->nc", sh_basis(direction, sh.shape[1]), sh[order])  # (N, 3)
    colour = torch.where(colour < 0, 0, colour)  # black can grow: it has a gradient

    columns = torch.arange(pinhole.width, dtype=position.dtype) + 0.5
    rows = torch.arange(pinhole.height, dtype=position.dtype) + 0.5
    pixel = torch.stack(torch.meshgrid(columns, rows, indexing="xy"), dim=-1)  # (H, W, 2)
    offset = pixel - mean2d[:, None, None]  # (N, H, W, 2)
    # offset^T inverse(axes axes^T) offset, as a sum of squares, which cannot cancel for needles.
    across = offset[..., :1] * axes[:, None, None, 1] - offset[..., 1:] * axes[:, None, None, 0]  # (N, H, W, 5)
    power = -0.5 * (across**2).sum(dim=-1) / _determinant(axes)[:, None, None]
    alpha = (opacity[:, None, None] * power.exp()).clamp(max=blend.alpha_max)
    alpha = torch.where(alpha >= blend.alpha_min, alpha, 0)  # (N, H, W)
    return _blend(alpha, colour)


def _project(
    view: Tensor, rotation: Tensor, scale: Tensor, rotation_of_view: Tensor, p: Pinhole, blend: OverBlend
) -> tuple[Tensor, Tensor]:
    """Means (N, 2) px, and axes (N, 2, 5) px: a covariance is these times their transpose. Zwicker et al. 2002."""
    depth = -view[:, 2]
    tangent_x, tangent_y = view[:, 0] / depth, view[:, 1] / depth
    mean2d = torch.stack([p.cx + p.fx * tangent_x, p.cy - p.fy * tangent_y], dim=1)
    limit_x, limit_y = c.FRUSTUM_CLAMP * p.width / 2 / p.fx, c.FRUSTUM_CLAMP * p.height / 2 / p.fy
    x, y = tangent_x.clamp(-limit_x, limit_x), tangent_y.clamp(-limit_y, limit_y)
    zero = torch.zeros_like(depth)
    jacobian = torch.stack(
        [
            torch.stack([p.fx / depth, zero, p.fx * x / depth], dim=1),
            torch.stack([zero, -p.fy / depth, -p.fy * y / depth], dim=1),
        ],
        dim=1,
    )  # (N, 2, 3)
    axes = jacobian @ rotation_of_view @ _rotation_matrix(rotation) * scale[:, None]  # (N, 2, 3)
    dilation = blend.dilation**0.5 * torch.eye(2, dtype=view.dtype)
    return mean2d, torch.cat([axes, dilation.expand(len(axes), 2, 2)], dim=2)


def _determinant(axes: Tensor) -> Tensor:
    """Of the covariances, (N,), by the formula of Cauchy and Binet: the squares of all 2 x 2 minors."""
    first, second = torch.combinations(torch.arange(5)).unbind(dim=1)
    minors = axes[:, 0, first] * axes[:, 1, second] - axes[:, 0, second] * axes[:, 1, first]
    return (minors**2).sum(dim=1)


def _is_drawn(mean2d: Tensor, axes: Tensor) -> Tensor:
    """Whether footprints (N,) are neither too large, too far away nor too thin."""
    variance = (axes**2).sum(dim=2).amax(dim=1)
    thinnest = _determinant(axes) / variance
    near = mean2d.abs().amax(dim=1) < c.FOOTPRINT_MAX
    return near & (variance < c.FOOTPRINT_MAX**2) & (thinnest * c.FOOTPRINT_MAX**2 > 1)


def _blend(alpha: Tensor, colour: Tensor) -> tuple[Tensor, Tensor]:
    """Blend front to back; a pixel ends after the Gaussian that takes its transmittance below the minimum."""
    one = alpha.new_ones(1, *alpha.shape[1:])
    before = torch.cumprod(torch.cat([one, 1 - alpha]), dim=0)  # (N + 1, H, W)
    alpha = torch.where(before[:-1] >= c.TRANSMITTANCE_MIN, alpha, 0)
    transmittance = torch.cumprod(torch.cat([one, 1 - alpha]), dim=0)
    return torch.einsum("nhw,nc->hwc", transmittance[:-1] * alpha, colour), transmittance[-1]


def _rotation_matrix(rotation: Tensor) -> Tensor:
    x, y, z, w = rotation.unbind(dim=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)  # (N, 3, 3)
