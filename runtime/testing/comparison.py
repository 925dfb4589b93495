"""Difference between an image and its golden image."""

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from gsgi.runtime.display import auto_exposure, tone_map
from gsgi.runtime.errors import UnsupportedError, UsageError

TILE = 16  # px; edge of the tiles, the worst of which is reported


@dataclass(frozen=True)
class Tolerance:
    """Limits for passing: mean FLIP, and the `ratio` of pixels that differ by more than `difference` (see compare)."""

    flip: float
    difference: float
    ratio: float


@dataclass(frozen=True)
class Difference:
    """Result of `compare`. Units of `largest` and `mean`: the whole range of 8 bits, or relative (see there).

    `tile` is (x, y) px of the upper left corner of the tile with the greatest FLIP mean, which is `tile_flip`. `heat`
    (H, W, 3) uint8 is the FLIP map in the colours of magma, dark where the images agree.
    """

    largest: float
    mean: float
    ratio: float
    flip: float
    tile: tuple[int, int]
    tile_flip: float
    heat: np.ndarray

    def figures(self, tolerance: Tolerance) -> dict[str, tuple[float, float]]:
        """The figures that decide, by name (see record.FIGURES), each with its limit."""
        return {"FLIP mean": (self.flip, tolerance.flip), "pixels off": (self.ratio, tolerance.ratio)}

    def passes(self, tolerance: Tolerance) -> bool:
        """Whether the difference is within the tolerance. One of infinity never is."""
        within = all(value <= limit for value, limit in self.figures(tolerance).values())
        return within and math.isfinite(self.largest)


def as_image(image) -> np.ndarray:
    """Convert an array-like to (H, W, 3): uint8 display-referred or float32 linear. (H, W) is repeated three times.

    Raises UsageError for other shapes and types; alpha is not compared, so it is refused.
    """
    array = np.asarray(image)
    if array.dtype.kind == "f":
        array = array.astype(np.float32)
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=2)
    if array.dtype not in (np.uint8, np.float32) or array.ndim != 3 or array.shape[2] != 3 or not array.size:
        got = f"{np.asarray(image).shape} {array.dtype}"
        raise UsageError(f"expected an image (H, W) or (H, W, 3) of uint8 or floats, got {got}")
    return np.ascontiguousarray(array)


def pixel_hash(image: np.ndarray) -> str:
    """SHA-256 of size, type and raw pixels: equal for equal bits, NaN included."""
    return hashlib.sha256(f"{image.shape} {image.dtype} ".encode() + image.tobytes()).hexdigest()


def shown(image: np.ndarray, golden: np.ndarray) -> np.ndarray:
    """Displayed form of an image of `as_image`, (H, W, 3) float32 in [0, 1].

    Linear values go through the tone curve, at the exposure that maps the log-average of the golden image to mid-grey.
    """
    if image.dtype == np.uint8:
        return image.astype(np.float32) / 255
    return tone_map(image, auto_exposure(golden))


def compare(actual: np.ndarray, golden: np.ndarray, difference: float) -> Difference:
    """Compare two images of `as_image` that have the same type and size.

    The difference of an 8-bit pixel is the greatest of its channels, as a fraction of the whole range. That of a linear
    pixel is relative to the golden value or, if that is smaller, to the mean of all finite golden values (all as
    magnitudes). Equal infinities and two NaNs do not differ; other values that are not finite differ by infinity. FLIP
    is computed from display-referred images (see `shown`), at 67 pixels per degree.
    """
    off = _pixel_difference(actual, golden)
    seen = shown(golden, golden), shown(actual, golden)
    errors = _flip(*seen, magma=False)[..., 0]
    tile, tile_flip = _worst_tile(errors)
    heat = (_flip(*seen, magma=True) * 255 + 0.5).astype(np.uint8)
    ratio = float((off > difference).mean())
    return Difference(float(off.max()), float(off.mean()), ratio, float(errors.mean()), tile, tile_flip, heat)


def _pixel_difference(actual: np.ndarray, golden: np.ndarray) -> np.ndarray:
    """(H, W) float64: the greatest difference among a pixel's channels."""
    if golden.dtype == np.uint8:
        return np.abs(actual.astype(int) - golden).max(axis=2) / 255
    actual, golden = actual.astype(np.float64), golden.astype(np.float64)
    finite = np.abs(golden[np.isfinite(golden)])
    floor = finite.mean() if finite.size else 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(actual - golden) / np.maximum(np.abs(golden), floor)
    same = (actual == golden) | (np.isnan(actual) & np.isnan(golden))
    return np.where(same, 0, np.where(np.isnan(off), np.inf, off)).max(axis=2)


def _flip(golden: np.ndarray, actual: np.ndarray, magma: bool) -> np.ndarray:
    """FLIP (Andersson et al. 2020) of each pixel, (H, W, 1) float32, or its colour in magma, (H, W, 3)."""
    try:
        import flip_evaluator
    except ImportError:
        raise UnsupportedError(
            "comparing screenshots needs flip-evaluator: install gsgi with its extra, '.[test]'"
        ) from None
    return flip_evaluator.evaluate(golden, actual, "LDR", applyMagma=magma)[0]


def _worst_tile(errors: np.ndarray) -> tuple[tuple[int, int], float]:
    """Upper left corner (x, y) px of the tile with the greatest mean of `errors` (H, W), and that mean."""
    height, width = errors.shape
    corners = [(x, y) for y in range(0, height, TILE) for x in range(0, width, TILE)]
    means = [float(errors[y : y + TILE, x : x + TILE].mean()) for x, y in corners]
    worst = int(np.argmax(means))
    return corners[worst], means[worst]
