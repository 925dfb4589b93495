"""The assertion that an image looks like its golden image."""

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsgi.runtime.display import to_uint8
from gsgi.runtime.errors import FileError
from gsgi.runtime.image import read_image, write_image

from .comparison import Difference, Tolerance, as_image, compare, pixel_hash, shown
from .driver import Driver
from .golden import Golden, golden_of
from .message import differs, missing, other_size, unreadable
from .record import PROPERTY, UPDATE, Record

ADVICE = "If this is as it should be: run again with --gsgi-update, look at the golden image, and commit it."


@dataclass(frozen=True, repr=False)  # pytest prints fixtures, and would print this one as one long line
class ScreenshotAssertion:
    """Value of the fixture `assert_screenshot` for one test: `test` (its id) in `file`, drawn by `driver`.

    Pictures of failures go to `output`. `update` is one of UPDATE, or None. `properties` belong to the test; a record
    of each comparison is added to them. Paths are reported relative to `root`.
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
        """Compare `image` with the golden image `name`; raise AssertionError that says how far off it is.

        `image` is (H, W, 3) or (H, W). A uint8 image is display-referred and has a .png as its golden image; a float
        image is linear and has an .exr. Equal pixels pass at once. Other images pass if the mean FLIP error is at most
        `max_flip` and a share of at most `max_ratio` of the pixels differs by more than `max_difference`. For uint8
        that is a fraction of the whole range; for floats, of the golden value or the mean of all golden values,
        whichever is greater. A value that is not finite where the golden image has another fails, and so does a golden
        image that is missing or cannot be read. With --gsgi-update, an image that would fail becomes the golden image.
        Raises UsageError for an invalid image or name, and FileError for a golden image that cannot be written.
        """
        __tracebackhide__ = True
        actual = as_image(image)
        golden = golden_of(self.file, name, ".png" if actual.dtype == np.uint8 else ".exr")
        used = next((path for path in golden.candidates(self.driver.key, self.driver.family) if path.is_file()), None)
        expected, problem = _read(used) if used else (None, "")
        if expected is not None and pixel_hash(actual) == pixel_hash(expected):
            return self._record(golden, used, "equal")
        difference, figures = None, {}
        if expected is not None and expected.shape == actual.shape:
            difference = compare(actual, expected, max_difference)
            tolerance = Tolerance(max_flip, max_difference, max_ratio)
            figures = difference.figures(tolerance)
            if difference.passes(tolerance):
                return self._record(golden, used, "close", figures)
        if self.update:
            return self._record(golden, self._write(actual, golden, used), "written", figures)
        if used is None:
            text = missing(name, [self._told(p) for p in golden.candidates(self.driver.key, self.driver.family)])
        elif problem:
            text = unreadable(name, problem)
        elif difference is None:
            text = other_size(name, self._told(used), actual, expected)
        else:
            text = differs(name, self._told(used), self.driver, actual, expected, difference, tolerance)
        try:
            pictures = self._save(name, actual, expected, difference)
        except (FileError, OSError) as error:
            pictures, places = {}, [f"  no pictures: {error}; --gsgi-report DIR puts them elsewhere"]
        else:
            places = self._places(pictures)
        text = "\n".join([text, *places, ADVICE])
        self._record(golden, used, "failed", figures, text, pictures)
        raise AssertionError(text)

    def _write(self, actual: np.ndarray, golden: Golden, used: Path | None) -> Path:
        """Make `actual` the golden image: the one compared with, or that of the requested driver or family."""
        assert self.update in UPDATE, self.update
        own = {"driver": self.driver.key, "family": self.driver.family}.get(self.update)
        path = golden.path(own) if own else used or golden.path()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_image(path, _stored(actual))
        except OSError as error:
            raise FileError(f"{self._told(path)}: cannot write: {error.strerror}") from None
        return path

    def _save(
        self, name: str, actual: np.ndarray, expected: np.ndarray | None, difference: Difference | None
    ) -> dict[str, str]:
        """Write the pictures of a failure; return their paths by what they show."""
        # Tests in several files may use the same screenshot name and run at the same time.
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
        return [f"  {what:<16} {path}" for what, path in places.items()]

    def _record(
        self, golden: Golden, used: Path | None, outcome: str, figures=None, text: str = "", pictures=None
    ) -> None:
        paths = self._told(golden.path()), self._told(used) if used else ""
        record = Record(self.test, golden.name, outcome, *paths, figures or {}, text, pictures or {})
        self.properties.append((PROPERTY, json.dumps(record._asdict())))

    def _told(self, path: Path) -> str:
        """Path relative to the root if it lies inside, else absolute; with forward slashes."""
        inside = path.is_relative_to(self.root)
        return (path.relative_to(self.root) if inside else Path(os.path.abspath(path))).as_posix()


def _read(path: Path) -> tuple[np.ndarray | None, str]:
    """A golden image, (H, W, 3) uint8 or float32, and ""; or None, and why it cannot be read."""
    try:
        pixels = read_image(path)
    except FileError as error:
        return None, str(error)
    return (to_uint8(pixels) if path.suffix == ".png" else pixels), ""


def _stored(image: np.ndarray) -> np.ndarray:
    """Reduce to one channel if all three are equal; a reader expands it to three again."""
    grey = image[..., :1]
    return grey if image.tobytes() == np.repeat(grey, 3, axis=2).tobytes() else image
