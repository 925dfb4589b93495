"""Intel Open Image Denoise on images of B."""

import numpy as np

from gsgi.runtime.display import auto_exposure

from .bends import bent

# Each channel is clamped to this multiple of the second largest value in its 3 x 3 neighbourhood. A pixel above that is
# a firefly, and one of 1e30 would spoil everything around it. Even a small lit area has neighbours as bright as it is.
FIREFLY = 2.0


def available() -> bool:
    """Whether the denoiser is installed."""
    from importlib.util import find_spec

    return find_spec("mitsuba_oidn") is not None


def denoise(indirect: np.ndarray, normal: np.ndarray, valid: np.ndarray, bend: np.ndarray | None = None) -> np.ndarray:
    """Denoise B (H, W, 3) float32, guided by `normal` (H, W, 3); pixels outside `valid` (H, W) become 0.

    `bend` (H, W, 3) is what normal maps add to those normals: what they do to B stays (see `bends`). Non-finite pixels
    count as 0, and fireflies are clamped first. Any number of threads gives the same bits.
    """
    import mitsuba_oidn
    from scipy.ndimage import distance_transform_edt, rank_filter

    if not valid.any():
        return np.zeros(indirect.shape, np.float32)
    clean = np.where(valid[..., None] & np.isfinite(indirect), indirect, 0).astype(np.float32)
    second = np.stack([rank_filter(clean[..., c], rank=-2, size=3) for c in range(3)], axis=-1)
    clean = np.minimum(clean, np.float32(FIREFLY) * second)
    factor = bent(clean, bend, valid) if bend is not None and bend.any() else None
    if factor is not None:
        clean = (clean / factor).astype(np.float32)
    # Fill invalid pixels from the nearest valid one: black there would look like a shadow and bleed across the edge.
    clean = clean[tuple(distance_transform_edt(~valid, return_distances=False, return_indices=True))]
    # Open Image Denoise accepts normals only together with an albedo. B has no albedo, so it is 1.
    white = np.ones_like(clean)
    guide = np.ascontiguousarray(normal, np.float32)
    # Set the scale, because Open Image Denoise's own estimate of it depends on the number of threads.
    scale = auto_exposure(clean)
    result = mitsuba_oidn.denoise(clean, white, guide, hdr=True, clean_aux=True, input_scale=scale)
    if factor is not None:
        result = (result * factor).astype(np.float32)
    return np.where(valid[..., None], result, 0)
