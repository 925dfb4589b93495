"""The bands of SH above the constant one as integers, of the light of a .gsgi file."""

import numpy as np

from gsgi.runtime.sampling import sh_basis

SH_CODE_MAX = 1 << 20
DIRECTIONS = 32  # evenly over the sphere, in which light is compared; twice as many changed nothing
DIM = 0.2  # errors count relative to the light in a direction and this share of that in the brightest
AT_ONCE = 1 << 12  # Gaussians whose matrices are computed together: they take 15 MB at degree 2


def pack_bands(sh: np.ndarray, dc: np.ndarray, steps: int) -> np.ndarray:
    """Codes (N, K - 1, 3) int64 of sh (N, K, 3) float64 but for the constant band, which is stored as dc (N, 3).

    They are in steps of 1 / steps of the brightest channel of dc. In a dark direction large coefficients cancel, and
    half a step of each is more than the light there. So they are rounded one after the other, the last one first, and
    each makes up for the errors of those before, that of the constant band included, by up to half a step: the nearest
    plane (Babai 1986) in least squares of errors relative to the light. No code is more than a step off.
    """
    unit = dc.max(axis=1, initial=0)[:, None, None] / steps
    wanted, stored = (_ratio(light, unit) for light in (sh, dc[:, None].astype(np.float64)))
    parts = [slice(first, first + AT_ONCE) for first in range(0, max(len(sh), 1), AT_ONCE)]
    return np.concatenate([_rounded_together(wanted[part], stored[part, 0]) for part in parts])


def pack_group_bands(sh: np.ndarray, dc: np.ndarray, steps: int) -> np.ndarray:
    """The same of a light group, in steps of the same channel: a tint that is the same everywhere takes no bits.

    From band 2 on one code serves all channels: the colour of the light differs little from that of band 0. A black
    channel has the codes of the brightest, which cost no bits beside them.
    """
    codes = _rounded(_ratio(sh[:, 1:], dc[:, None] / steps))
    weight = np.square(dc, dtype=np.float64)[:, None]
    grey = (sh[:, 4:] * dc[:, None]).sum(axis=2, keepdims=True)
    codes[:, 3:] = _rounded(_ratio(grey, weight.sum(axis=2, keepdims=True) / steps))
    brightest = np.take_along_axis(codes, dc.argmax(axis=1)[:, None, None], axis=2)
    return np.where(dc[:, None] > 0, codes, brightest)


def _rounded_together(wanted: np.ndarray, stored: np.ndarray) -> np.ndarray:
    """Codes (N, K - 1, 3) of coefficients (N, K, 3) in steps, of which the first ones are stored as (N, 3)."""
    # The first coefficient comes last, since it is rounded already.
    wanted, functions = np.roll(wanted.swapaxes(1, 2), -1, axis=2), np.roll(_functions(wanted.shape[1]), -1, axis=1)
    light = np.einsum("nck,jk->ncj", wanted, functions)
    brightest = light.max(axis=2, keepdims=True)
    weight = (np.maximum(_ratio(light, brightest), 0) + DIM) ** -2
    products = functions[:, :, None] * functions[:, None]
    lower = np.linalg.cholesky(np.einsum("ncj,jkl->nckl", weight, products))
    error, codes = np.zeros_like(wanted), np.zeros(wanted.shape, np.int64)
    error[:, :, -1] = stored - wanted[:, :, -1]
    for i in reversed(range(wanted.shape[2] - 1)):
        carried = (lower[:, :, i + 1 :, i] * error[:, :, i + 1 :]).sum(axis=2) / lower[:, :, i, i]
        codes[:, :, i] = _rounded(wanted[:, :, i] - np.clip(carried, -0.5, 0.5))
        error[:, :, i] = codes[:, :, i] - wanted[:, :, i]
    return codes[:, :, :-1].swapaxes(1, 2)


def _functions(count: int) -> np.ndarray:
    """Values (DIRECTIONS, count) float64 of the SH basis, in directions on a spiral of equal areas."""
    number = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * number / DIRECTIONS, np.pi * (1 + 5**0.5) * number
    across = np.sqrt(1 - z * z)
    return sh_basis(np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1), count)


def _ratio(values: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """`values` in units, as far as codes go; 0 where the unit is 0."""
    ratio = np.divide(values, unit, out=np.zeros_like(values), where=unit > 0)
    return np.clip(ratio, -SH_CODE_MAX, SH_CODE_MAX)


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.rint(values).astype(np.int64)
