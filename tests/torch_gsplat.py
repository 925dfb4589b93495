"""gsplat.rasterization in plain torch: what gsplat 1.5.3 documents and does, for one camera and packed=False.

With it, the code for a GPU is tested without one. Conventions, the cap on alpha and the end of a pixel are gsplat's.
"""

import torch
from torch import Tensor

ALPHA_MIN, ALPHA_MAX, TRANSMITTANCE_MIN = 1 / 255, 0.999, 1e-4


def rasterization(
    means: Tensor,  # (N, 3)
    quats: Tensor,  # (N, 4) wxyz, of any length
    scales: Tensor,  # (N, 3)
    opacities: Tensor,  # (N,)
    colors: Tensor,  # (N, D)
    viewmats: Tensor,  # (1, 4, 4) camera from world: x right, y down, z forward
    Ks: Tensor,  # noqa: N803  (1, 3, 3)
    width: int,
    height: int,
    near_plane: float = 0.01,
    eps2d: float = 0.3,
    packed: bool = True,
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Image (1, H, W, D), opacity (1, H, W, 1), and `radii`, `means2d`, `conics` of (1, N, 2 or 3)."""
    assert len(means), "gsplat divides by the number of Gaussians"
    assert not packed
    camera = means @ viewmats[0, :3, :3].T + viewmats[0, :3, 3]
    in_front = camera[:, 2] >= near_plane
    camera = torch.where(in_front[:, None], camera, 1)
    covariance = _covariance(quats, scales, viewmats[0, :3, :3])
    means2d, cov2d = _project(camera, covariance, Ks[0], width, height)
    xx, xy, yy = cov2d[:, 0, 0] + eps2d, cov2d[:, 0, 1], cov2d[:, 1, 1] + eps2d
    conics = torch.stack([yy, -xy, xx], dim=1) / (xx * yy - xy * xy)[:, None]

    extent = (2 * (opacities / ALPHA_MIN).clamp(min=1).log()).sqrt().clamp(max=3.33)
    radii = torch.stack([(extent * v.sqrt()).ceil() for v in (xx, yy)], dim=1).detach()
    size = means2d.new_tensor([width, height])
    inside = ((means2d + radii > 0) & (means2d - radii < size)).all(dim=1)
    radii = torch.where((in_front & inside & (opacities >= ALPHA_MIN))[:, None], radii, 0).int()

    meta = {"radii": radii[None], "means2d": means2d[None], "conics": conics[None]}
    order = torch.argsort(camera[:, 2], stable=True)
    order = order[(radii[order] > 0).all(dim=1)]
    alpha = _alpha(meta["means2d"][0, order], meta["conics"][0, order], opacities[order], width, height)
    after = torch.cumprod(1 - alpha, dim=0)
    alpha = torch.where(after > TRANSMITTANCE_MIN, alpha, 0)  # a pixel ends before it falls below this
    after = torch.cumprod(torch.cat([torch.ones_like(alpha[:1]), 1 - alpha]), dim=0)
    if not len(order):
        return means2d.sum() * 0 + colors.new_zeros(1, height, width, colors.shape[1]), after, meta
    image = torch.einsum("nhw,nc->hwc", after[:-1] * alpha, colors[order])
    return image[None], 1 - after[-1][None, ..., None], meta


def _covariance(quats: Tensor, scales: Tensor, camera_from_world: Tensor) -> Tensor:
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1).unbind(dim=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    axes = camera_from_world @ torch.stack([torch.stack(row, dim=1) for row in rows], dim=1) * scales[:, None]
    return axes @ axes.mT


def _project(camera: Tensor, covariance: Tensor, k: Tensor, width: int, height: int) -> tuple[Tensor, Tensor]:
    """Means (N, 2) and covariances (N, 2, 2), linearised at most 0.15 of the image's size beyond its edges."""
    x, y, z = camera.unbind(dim=1)
    fx, fy, cx, cy = k[0, 0], k[1, 1], k[0, 2], k[1, 2]
    margin_x, margin_y = 0.15 * width / fx, 0.15 * height / fy
    tx = z * torch.clamp(x / z, -(cx / fx + margin_x), (width - cx) / fx + margin_x)
    ty = z * torch.clamp(y / z, -(cy / fy + margin_y), (height - cy) / fy + margin_y)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([fx / z, zero, -fx * tx / z**2], dim=1), torch.stack([zero, fy / z, -fy * ty / z**2], dim=1)],
        dim=1,
    )
    return torch.stack([fx * x / z + cx, fy * y / z + cy], dim=1), jacobian @ covariance @ jacobian.mT


def _alpha(mean: Tensor, conic: Tensor, opacity: Tensor, width: int, height: int) -> Tensor:
    """Alpha (M, H, W) at the pixels' centres."""
    columns, rows = torch.arange(width).to(mean) + 0.5, torch.arange(height).to(mean) + 0.5
    dx = (mean[:, :1] - columns)[:, None]  # (M, 1, W)
    dy = (mean[:, 1:] - rows)[:, :, None]  # (M, H, 1)
    a, b, c = (conic[:, i, None, None] for i in range(3))
    alpha = opacity[:, None, None] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
    alpha = alpha.clamp(max=ALPHA_MAX)
    return torch.where(alpha >= ALPHA_MIN, alpha, 0)
