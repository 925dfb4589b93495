"""Intel Open Image Denoise on images of B."""

import numpy as np

# Times the 99th percentile: brighter pixels are fireflies. One of 1e30 would poison its whole neighbourhood.
FIREFLY = 8.0


def available() -> bool:
    """Whether the denoiser is installed."""
    from importlib.util import find_spec

    return find_spec("mitsuba_oidn") is not None


def denoise(indirect: np.ndarray, normal: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """B (H, W, 3) float32 without its noise; `normal` (H, W, 3) guides it; pixels outside `valid` (H, W) become 0.

    Non-finite pixels count as 0 and fireflies are clamped first.
    """
    import mitsuba_oidn

    clean = np.where(valid[..., None] & np.isfinite(indirect), indirect, 0).astype(np.float32)
    if valid.any():
        clean = np.minimum(clean, FIREFLY * np.quantile(clean[valid], 0.99))
    # Normals are accepted only together with an albedo; B has none, so it is 1.
    white = np.ones_like(clean)
    guide = np.ascontiguousarray(normal, np.float32)
    result = mitsuba_oidn.denoise(np.ascontiguousarray(clean), white, guide, hdr=True, clean_aux=True)
    return np.where(valid[..., None], result, 0)
