"""Real spherical harmonics in torch, on any device."""

import torch
from torch import Tensor

from gsgi.runtime import constants as c


def sh_basis(direction: Tensor, count: int) -> Tensor:
    """The first `count` basis functions (N, count) at unit vectors (N, 3)."""
    x, y, z = direction.unbind(dim=1)
    xx, yy, zz = x * x, y * y, z * z
    basis = [
        torch.full_like(x, c.SH_C0),
        *(-c.SH_C1 * y, c.SH_C1 * z, -c.SH_C1 * x),
        *(c.SH_C2_0 * x * y, -c.SH_C2_0 * y * z, c.SH_C2_1 * (2 * zz - xx - yy)),
        *(-c.SH_C2_0 * x * z, c.SH_C2_2 * (xx - yy)),
        *(-c.SH_C3_0 * y * (3 * xx - yy), c.SH_C3_1 * x * y * z, -c.SH_C3_2 * y * (4 * zz - xx - yy)),
        *(c.SH_C3_3 * z * (2 * zz - 3 * xx - 3 * yy), -c.SH_C3_2 * x * (4 * zz - xx - yy)),
        *(c.SH_C3_4 * z * (xx - yy), -c.SH_C3_0 * x * (xx - 3 * yy)),
    ]
    return torch.stack(basis[:count], dim=1)
