"""Writes layers as image files, and combines pictures into panels."""

from pathlib import Path

import numpy as np

from gsgi.runtime.display import auto_exposure, encode_srgb, to_uint8, tone_map
from gsgi.runtime.image import write_image

MARGIN = 6  # px between panels
CAPTION = 22  # px above a panel
LIGHT = ("final", "primary", "indirect")  # layers that are exposed and tone-mapped
BAND = 256  # rows that are tone-mapped at once, in double precision


def write_layer(path: str, layer: str, values: np.ndarray, exposure: float | None) -> None:
    """Write a layer, (H, W, 3) or (H, W) float32, to an image file.

    A .png file gets visible values: light is exposed and tone-mapped, albedo is sRGB-encoded, normals are halved and
    shifted by 1/2, and depth is divided by the largest depth. Other files, such as .exr, get the values unchanged.
    """
    if Path(path).suffix.lower() == ".png":
        if layer in LIGHT and exposure is None:
            exposure = auto_exposure(values)
        bands = np.split(values, range(BAND, len(values), BAND))
        largest = float(values.max())
        write_image(path, np.concatenate([to_uint8(_visible(layer, band, exposure, largest)) for band in bands]))
    else:
        write_image(path, values if values.ndim == 3 else values[..., None])


def panels(images: dict[str, np.ndarray]) -> np.ndarray:
    """Pictures (H, W, 3) in [0, 1] side by side under their captions, as (H', W', 3) uint8."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = next(iter(images.values())).shape[:2]
    canvas = Image.new("RGB", (len(images) * (width + MARGIN) - MARGIN, height + CAPTION), "white")
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(size=14)
    for i, (caption, image) in enumerate(images.items()):
        left = i * (width + MARGIN)
        draw.text((left + 2, 2), caption, fill="black", font=font)
        canvas.paste(Image.fromarray(to_uint8(image)), (left, CAPTION))
    return np.asarray(canvas)


def _visible(layer: str, values: np.ndarray, exposure: float | None, largest: float) -> np.ndarray:
    """Rows of a layer as display-referred values in [0, 1], (H, W, 3); `largest` is the largest value of the layer."""
    if layer == "depth":
        return np.repeat((values / (largest or 1.0))[..., None], 3, axis=2)
    if layer == "normal":
        return np.where(values.any(axis=2, keepdims=True), values * 0.5 + 0.5, 0)
    if layer == "albedo":
        return encode_srgb(np.clip(values, 0, 1))
    return tone_map(values, exposure)
