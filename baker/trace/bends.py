"""What normal maps do to B, so that it can be taken out of an image before the noise is, and put back afterwards.

Under a normal map B differs from pixel to pixel, and a denoiser blurs the difference or keeps the noise. But over a few
pixels B changes by the place and by the normal, nearly in proportion to how far that is bent: the slopes follow from
all pixels of a window by linear regression (Bitterli et al. 2016), averaged over windows (He et al. 2013).
"""

import numpy as np

WINDOW = 17  # px, edge of the squares in which the slopes are the same

# Squared length of a bend, and of a way in windows: where the pixels of a window hardly differ by more, noise would
# decide on the slopes.
RIDGE = 1e-3

MOST = 2.0  # by which a bend changes light at most; with 10, spots in a dark view of Sponza were 2 dB further off


def bent(indirect: np.ndarray, bend: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """By what factor (H, W, 3) float64 normals that are bent change B (H, W, 3); it is 1 where they are not.

    `bend` (H, W, 3) is the unit normal that is seen less that of the surface without its map. Only pixels in `valid`
    (H, W) count.
    """
    there = valid[:, :, None, None]
    share = np.maximum(_mean(there), 1 / WINDOW**2)  # at least one pixel, unless there is none

    def around(values: np.ndarray) -> np.ndarray:
        return _mean(np.where(there, values, 0)) / share

    place = np.stack(np.mgrid[: len(valid), : valid.shape[1]], axis=2) / WINDOW
    causes, light = np.concatenate([bend, place], axis=2)[..., None], indirect[:, :, None].astype(np.float64)
    mean_cause, mean_light = around(causes), around(light)
    covariance = around(causes * causes.swapaxes(2, 3)) - mean_cause * mean_cause.swapaxes(2, 3)
    together = around(causes * light) - mean_cause * mean_light
    slope = np.linalg.solve(covariance + RIDGE * np.eye(causes.shape[2]), together)[:, :, :3]
    unbent = around(mean_light - (mean_cause[:, :, :3] * slope).sum(axis=2, keepdims=True))
    unbent = np.maximum(unbent, mean_light / MOST)[:, :, 0]
    change = (bend[..., None] * around(slope)).sum(axis=2)
    factor = 1 + np.divide(change, unbent, out=np.zeros_like(change), where=unbent > 0)
    return np.clip(factor, 1 / MOST, MOST)


def _mean(values: np.ndarray) -> np.ndarray:
    """The mean of values (H, W, M, N) float64 over the window around each pixel, 0 beyond the image."""
    from scipy.ndimage import uniform_filter

    return uniform_filter(values.astype(np.float64), (WINDOW, WINDOW, 0, 0), mode="constant")
