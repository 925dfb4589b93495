"""The sun of an environment image, found and taken out of it, so that it can be a directional light."""

from typing import NamedTuple

import numpy as np

RADIUS = np.radians(3.0)  # rad; around its brightest texel, with the glow that a lens adds
TEXELS = 2.0  # the same in texels, for small images
CONTRAST = 10.0  # times the mean radiance around it, up to twice that far: what is darker is sky
SHARE_LEAST = 0.1  # of all light of the image; less makes no shadows that one sees


class Sun(NamedTuple):
    """The direction `towards` the sun (3,), unit, and the irradiance (3,) of a surface that faces it.

    `share` is the share of the light of the image that is the sun's, and `rest` (H, W, 3) float32 is the image without.
    """

    towards: np.ndarray
    irradiance: np.ndarray
    share: float
    rest: np.ndarray


def find_sun(radiance: np.ndarray) -> Sun | None:
    """The sun of an image as in `Environment.radiance`, which is not rotated; None if nothing in it is like a sun."""
    light = radiance.mean(axis=2, dtype=np.float64)
    if not light.any():
        return None
    height, width = light.shape
    radius = max(RADIUS, TEXELS * np.pi / height, TEXELS * 2 * np.pi / width)
    towards = _directions(height, width)
    cosine = towards @ towards[np.unravel_index(light.argmax(), light.shape)]
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    angle = np.broadcast_to(((edges[:-1] - edges[1:]) * 2 * np.pi / width)[:, None], light.shape)  # solid angle, sr
    ring = (cosine <= np.cos(radius)) & (cosine > np.cos(min(2 * radius, np.pi)))
    if not ring.any():
        return None
    around = np.average(radiance[ring], axis=0, weights=angle[ring])
    disk = (cosine > np.cos(radius)) & (light > CONTRAST * around.mean())
    flux = np.maximum(radiance[disk] - around, 0) * angle[disk, None]
    share = flux.mean(axis=1).sum() / (light * angle).sum()
    if share < SHARE_LEAST:
        return None
    middle = flux.sum(axis=1) @ towards[disk]
    rest = radiance.astype(np.float32, copy=True)
    rest[disk] = around
    return Sun(middle / np.linalg.norm(middle), flux.sum(axis=0), float(share), rest)


def _directions(height: int, width: int) -> np.ndarray:
    """Unit directions (H, W, 3) of the middles of an image's texels."""
    polar, azimuth = (np.arange(height) + 0.5) / height * np.pi, ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    across = np.sin(polar)[:, None]
    up = np.broadcast_to(np.cos(polar)[:, None], (height, width))
    return np.stack([across * np.sin(azimuth), up, -across * np.cos(azimuth)], axis=2)
