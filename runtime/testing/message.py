"""Messages of failed comparisons."""

from collections.abc import Sequence

import numpy as np

from .comparison import TILE, Difference, Tolerance, pixel_hash
from .driver import Driver
from .record import number, percent

HASH_LENGTH = 16  # hexadecimal digits shown; enough to tell two images apart


def missing(name: str, candidates: Sequence[str]) -> str:
    """Message for a golden image that was not found."""
    return "\n".join([f"screenshot {name!r} has no golden image; looked for", *(f"  {path}" for path in candidates)])


def unreadable(name: str, problem: str) -> str:
    """Message for a golden image that cannot be read."""
    return f"screenshot {name!r} has a golden image that cannot be read: {problem}"


def other_size(name: str, golden: str, actual: np.ndarray, expected: np.ndarray) -> str:
    """Message for images of different size."""
    sizes = [f"{image.shape[1]} x {image.shape[0]}" for image in (actual, expected)]
    return f"screenshot {name!r} is {sizes[0]} px, its golden image {golden} is {sizes[1]}"


def differs(
    name: str,
    golden: str,
    driver: Driver,
    actual: np.ndarray,
    expected: np.ndarray,
    difference: Difference,
    tolerance: Tolerance,
) -> str:
    """Message for images that differ by more than the tolerance."""
    unit = "of the range" if actual.dtype == np.uint8 else "of the golden value"
    x, y = difference.tile
    right, bottom = min(x + TILE, actual.shape[1]), min(y + TILE, actual.shape[0])
    largest = percent(difference.largest) if np.isfinite(difference.largest) else "infinite (never allowed)"
    hashes = " / ".join(pixel_hash(image)[:HASH_LENGTH] for image in (actual, expected))
    rows = {
        "driver": driver.key,
        "difference": f"max {largest}, mean {percent(difference.mean)} {unit}",
        "pixels off": f"{percent(difference.ratio)} by more than {percent(tolerance.difference)}"
        f" ({_verdict(difference.ratio, tolerance.ratio, percent)})",
        "FLIP": f"mean {number(difference.flip)} ({_verdict(difference.flip, tolerance.flip, number)})",
        "worst tile": f"x {x} to {right}, y {y} to {bottom}: FLIP mean {number(difference.tile_flip)}",
        "sha256": f"{hashes} (actual / golden)",
    }
    lines = (f"  {label:<16} {text}" for label, text in rows.items())
    return "\n".join([f"screenshot {name!r} differs from its golden image {golden}", *lines])


def _verdict(value: float, limit: float, spelled) -> str:
    return f"allowed {spelled(limit)}{': too much' if value > limit else ''}"
