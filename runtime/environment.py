"""Read an environment image, equirectangular with row 0 up, in the layout of `Environment.radiance`."""

from pathlib import Path

import numpy as np

from .errors import FileError, SceneError
from .image import one_line, open_image

SUFFIXES = (".hdr", ".exr")
SIZE_MAX = (16384, 8192)  # texels, width and height: 1.5 GiB as float32
TEXELS = (1024, 512)  # width, height; light is only integrated over the image, so more texels do not help
BAND_ROWS = 256  # rows filtered at a time


def read_environment(path: str | Path) -> np.ndarray:
    """Radiance (H, W, 3) float32, linear Rec.709, of an .hdr or .exr file.

    An image with fewer than three channels repeats its first one. Images larger than TEXELS are averaged over solid
    angle down to that size. Raises FileError if the file cannot be read, and SceneError if it is of another type, is
    too large, or holds values that are not finite or are negative.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise SceneError(f"{path}: expected an environment image in .hdr or .exr")
    try:
        with open(path, "rb"):
            pixels = _read(Path(path))
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise FileError(f"{path}: cannot read: {error}") from None
    invalid = int(np.count_nonzero(~(np.isfinite(pixels) & (pixels >= 0)).all(axis=2)))
    if invalid:
        raise SceneError(f"{path}: expected finite radiance of at least 0, got {invalid} other texels")
    color = pixels if pixels.shape[2] == 3 else np.repeat(pixels[..., :1], 3, axis=2)
    return _reduce(color)


def _read(path: Path) -> np.ndarray:
    """First image of a file, at most three channels, (H, W, C) float32. Raises ValueError; SceneError if too large."""
    source = open_image(path)
    spec = source.spec()
    if spec.width > SIZE_MAX[0] or spec.height > SIZE_MAX[1]:
        raise SceneError(f"{path}: expected at most {SIZE_MAX[0]} x {SIZE_MAX[1]} texels, "
                         f"got {spec.width} x {spec.height}")  # fmt: skip
    pixels = source.read_image(0, 0, 0, min(spec.nchannels, 3), "float")
    if pixels is None:
        raise ValueError(one_line(source.geterror()))
    return pixels


def _reduce(image: np.ndarray) -> np.ndarray:
    """Average an image (H, W, 3) float32 over solid angle down to at most TEXELS, each axis separately."""
    height, width = image.shape[:2]
    rows, columns = min(height, TEXELS[1]), min(width, TEXELS[0])
    if (rows, columns) == (height, width):
        return image
    bands = [image[first : first + BAND_ROWS] for first in range(0, height, BAND_ROWS)]
    narrow = [_average(band, 1, np.linspace(0, 1, width + 1), np.linspace(0, 1, columns + 1)) for band in bands]
    # The solid angle between two polar angles is proportional to the difference of their cosines.
    edges = (-np.cos(np.linspace(0, np.pi, count + 1)) for count in (height, rows))
    return _average(np.concatenate(narrow), 0, *edges).astype(np.float32)


def _average(values: np.ndarray, axis: int, edges: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Means (float64) along `axis` between the edges `wanted`, of values that are constant between `edges`."""
    values = np.moveaxis(values, axis, 0)
    shape = (-1, *[1] * (values.ndim - 1))
    steps = values * np.diff(edges).reshape(shape)
    integral = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
    at = np.interp(wanted, edges, np.arange(len(edges)))
    below = np.minimum(at.astype(int), len(edges) - 2)
    there = integral[below] + steps[below] * (at - below).reshape(shape)
    return np.moveaxis(np.diff(there, axis=0) / np.diff(wanted).reshape(shape), 0, axis)
