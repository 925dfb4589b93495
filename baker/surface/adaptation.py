"""The brightness to which eyes adapt where they look: that of what lies around it in their view."""

import numpy as np

from .seen_surface import SIZE

CELLS = 16  # along an edge of the image of a view
WEIGHTS = np.array([1, 4, 6, 4, 1]) / 16  # of a cell among its neighbours, along each edge: some 8 degrees across


def seen_around(camera: np.ndarray, place: np.ndarray, light: np.ndarray) -> np.ndarray:
    """The log-average (S,) float32 of the light around S samples in the views from which they come.

    They lie at place (S, 2), px, of the images of cameras (S,), and their B has the brightness `light` (S,), radiance.
    Each part of an image counts alike, however many samples lie in it, as it does for `auto_exposure`; black parts do
    not count. The result is 0 where all around is black.
    """
    from scipy.ndimage import correlate1d

    if not len(camera):
        return np.empty(0, np.float32)
    x, y = np.clip(place * (CELLS / SIZE), 0, CELLS - 1).astype(np.int64).T
    cell = (camera.astype(np.int64) * CELLS + y) * CELLS + x
    size = (int(camera.max()) + 1) * CELLS**2
    count = np.maximum(np.bincount(cell, minlength=size), 1)
    mean = np.bincount(cell, light, size) / count
    lit = mean > 0
    logs = np.log(mean, out=np.zeros_like(mean), where=lit)
    images = np.stack([logs, lit]).reshape(2, -1, CELLS, CELLS)
    for axis in (2, 3):
        images = correlate1d(images, WEIGHTS, axis, mode="constant")
    total, weight = images.reshape(2, -1)
    around = np.exp(np.divide(total, weight, out=np.full_like(total, -np.inf), where=weight > 0))
    return around[cell].astype(np.float32)
