"""The assertion: an image looks as its golden image does."""

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsgi.runtime.display import to_uint8
from gsgi.runtime.image import read_image, write_image

from .comparison import Difference, Tolerance, as_image, compare, pixel_hash, shown
from .driver import Driver
from .golden import Golden, golden_of
from .message import differs, missing, other_size
from .record import PROPERTY, UPDATE, Record


@dataclass(frozen=True, repr=False)  # pytest prints fixtures, and this one in one long line
class ScreenshotAssertion:
    """What the fixture `assert_screenshot` gives to one test: `test` (its id) in `file`, drawn by `driver`.

    Pictures of what fails go to `output`. `update` is one of UPDATE, or None; `properties` are the test's, which take a
    record of each comparison; paths are told relative to `root`.
    """

    test: str
    file: Path
    driver: Driver
    output: Path
    root: Path
    update: str | None
    properties: list[tuple[str, object]]

    def __call__(
        self, image, name: str, *, max_flip: float = 0.02, max_difference: float = 2 / 255, max_ratio: float = 0.001
    ) -> None:
        """Compare `image` with the golden image `name` and raise AssertionError, which says how far off it is.

        `image` (H, W, 3) or (H, W): uint8, display-referred, has a .png as its golden image; floats, linear, an .exr.
        Equal pixels pass at once. Others pass where the mean FLIP error is at most `max_flip` and a share of at most
        `max_ratio` of the pixels is off by more than `max_difference`: of the whole range for uint8, for floats of the
        golden value or the mean of all, whichever is greater. A missing golden image fails. With --gsgi-update what
        would fail becomes the golden image. Raises UsageError for an image or a name that cannot be.
        """
        __tracebackhide__ = True
        actual = as_image(image)
        golden = golden_of(self.file, name, ".png" if actual.dtype == np.uint8 else ".exr")
        used = next((path for path in golden.candidates(self.driver.key, self.driver.family) if path.is_file()), None)
        expected = None if used is None else _read(used)
        if expected is not None and pixel_hash(actual) == pixel_hash(expected):
            return self._record(golden, used, "equal")
        difference = None
        if expected is not None and expected.shape == actual.shape:
            difference = compare(actual, expected, max_difference)
            tolerance = Tolerance(max_flip, max_difference, max_ratio)
            if difference.passes(tolerance):
                return self._record(golden, used, "close")
        if self.update:
            return self._record(golden, self._write(actual, golden, used), "written")
        if used is None:
            text = missing(name, [self._told(p) for p in golden.candidates(self.driver.key, self.driver.family)])
        elif difference is None:
            text = other_size(name, self._told(used), actual, expected)
        else:
            text = differs(name, self._told(used), self.driver, actual, expected, difference, tolerance)
        pictures = self._save(name, actual, expected, difference)
        text = "\n".join([text, *self._places(pictures)])
        self._record(golden, used, "failed", text, pictures)
        raise AssertionError(text)

    def _write(self, actual: np.ndarray, golden: Golden, used: Path | None) -> Path:
        """Make `actual` the golden image: the one it was compared with, or that of the driver or family asked for."""
        assert self.update in UPDATE, self.update
        own = {"driver": self.driver.key, "family": self.driver.family}.get(self.update)
        path = golden.path(own) if own else used or golden.path()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image(path, _stored(actual))
        return path

    def _save(
        self, name: str, actual: np.ndarray, expected: np.ndarray | None, difference: Difference | None
    ) -> dict[str, str]:
        """Write what there is to see of a failure; the paths by what they show."""
        # Tests of one name may stand in several files, and run at the same time.
        stem = f"{name}-{hashlib.sha256(self.test.encode()).hexdigest()[:8]}"
        reference = actual if expected is None else expected
        pictures = {"actual": to_uint8(shown(actual, reference))}
        if actual.dtype != np.uint8:
            pictures["actual, linear"] = actual
        if expected is not None:
            pictures["expected"] = to_uint8(shown(expected, expected))
        if difference is not None:
            pictures["difference"] = difference.heat
        self.output.mkdir(parents=True, exist_ok=True)
        paths = {}
        for what, pixels in pictures.items():
            suffix = ".png" if pixels.dtype == np.uint8 else ".exr"
            path = self.output / f"{stem}-{what.partition(',')[0]}{suffix}"
            write_image(path, _stored(pixels))
            paths[what] = self._told(path)
        return paths

    def _places(self, pictures: dict[str, str]) -> list[str]:
        places = pictures | {"report": self._told(self.output / "report.html")}
        advice = "If this is as it should be: run again with --gsgi-update, look at the golden image, and commit it."
        return [*(f"  {what:<16} {path}" for what, path in places.items()), advice]

    def _record(self, golden: Golden, used: Path | None, outcome: str, text: str = "", pictures=None) -> None:
        told = self._told(used) if used else ""
        record = Record(self.test, golden.name, outcome, self._told(golden.path()), told, text, pictures or {})
        self.properties.append((PROPERTY, json.dumps(record._asdict())))

    def _told(self, path: Path) -> str:
        """Relative to the root where it lies inside, with forward slashes."""
        inside = path.is_relative_to(self.root)
        return (path.relative_to(self.root) if inside else Path(os.path.abspath(path))).as_posix()


def _read(path: Path) -> np.ndarray:
    """A golden image, (H, W, 3) uint8 or float32."""
    pixels = read_image(path)
    return to_uint8(pixels) if path.suffix == ".png" else pixels


def _stored(image: np.ndarray) -> np.ndarray:
    """One channel where all three are equal: a reader makes three of it again."""
    grey = image[..., :1]
    return grey if image.tobytes() == np.repeat(grey, 3, axis=2).tobytes() else image
