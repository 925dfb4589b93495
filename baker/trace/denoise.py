"""Intel Open Image Denoise on images of B."""

import numpy as np

from gsgi.runtime.display import auto_exposure

# Times the second brightest of a pixel's 3 x 3 neighbourhood: what stands out further is a firefly, and one of 1e30
# would poison everything around it. An area of light, however small in the image, has neighbours as bright.
FIREFLY = 2.0


def available() -> bool:
    """Whether the denoiser is installed."""
    from importlib.util import find_spec

    return find_spec("mitsuba_oidn") is not None


def denoise(indirect: np.ndarray, normal: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """B (H, W, 3) float32 without its noise; `normal` (H, W, 3) guides it; pixels outside `valid` (H, W) become 0.

    Non-finite pixels count as 0 and fireflies are clamped first. The same bits for any number of threads.
    """
    import mitsuba_oidn
    from scipy.ndimage import distance_transform_edt, rank_filter

    if not valid.any():
        return np.zeros(indirect.shape, np.float32)
    clean = np.where(valid[..., None] & np.isfinite(indirect), indirect, 0).astype(np.float32)
    second = np.stack([rank_filter(clean[..., c], rank=-2, size=3) for c in range(3)], axis=-1)
    clean = np.minimum(clean, np.float32(FIREFLY) * second)
    # The light beside a mask goes on under it: black there would look like a shadow, and be smeared out over its edge.
    clean = clean[tuple(distance_transform_edt(~valid, return_distances=False, return_indices=True))]
    # Normals are accepted only together with an albedo; B has none, so it is 1.
    white = np.ones_like(clean)
    guide = np.ascontiguousarray(normal, np.float32)
    # Open Image Denoise's own estimate of the scale depends on the number of threads.
    scale = auto_exposure(clean)
    result = mitsuba_oidn.denoise(clean, white, guide, hdr=True, clean_aux=True, input_scale=scale)
    return np.where(valid[..., None], result, 0)
