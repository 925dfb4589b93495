"""Golden images on disk: which one belongs to a driver, and which ones are unused."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from gsgi.runtime.errors import UsageError

FOLDER = "screenshots"  # beside the test files; contains a folder for each of them
SUFFIXES = (".png", ".exr")  # display-referred, linear
_NAME = re.compile(r"\w[\w.+-]*", re.ASCII)


class Golden(NamedTuple):
    """The image `name` of a test file: `folder` / name.suffix, or name@driver.suffix."""

    folder: Path
    name: str
    suffix: str

    def path(self, driver: str = "") -> Path:
        """File for a driver's key or family; without one, the file for all drivers."""
        return self.folder / f"{self.name}{'@' * bool(driver)}{driver}{self.suffix}"

    def candidates(self, key: str, family: str) -> tuple[Path, Path, Path]:
        """Files that may hold the image, the most specific first."""
        return self.path(key), self.path(family), self.path()


def golden_of(test_file: Path, name: str, suffix: str) -> Golden:
    """The golden image that a test in `test_file` calls `name`. Raises UsageError for an invalid name."""
    if not _NAME.fullmatch(name):
        raise UsageError(f"expected a screenshot's name of letters, digits and _ . + -, . + - not first, got {name!r}")
    return Golden(folder_of(test_file), name, suffix)


def folder_of(test_file: Path) -> Path:
    """Folder of the golden images of a test file."""
    return test_file.parent / FOLDER / test_file.stem


def unused(test_files: Iterable[Path], asked: set[Golden]) -> list[Path]:
    """Golden images, for any driver, that no test of these files asked for; sorted.

    Includes all golden images beside these files whose own test file no longer exists. Every test of `test_files` must
    have run to its end.
    """
    test_files = set(test_files)
    folders = {folder_of(file) for file in test_files}
    for parent in {file.parent for file in test_files}:
        present = {file.stem for file in parent.glob("*.py")}
        folders |= {folder for folder in parent.glob(f"{FOLDER}/*/") if folder.name not in present}
    images = (path for folder in folders for path in folder.glob("*") if path.suffix in SUFFIXES)
    return sorted(path for path in images if golden_in(path) not in asked)


def golden_in(path: Path) -> Golden:
    """The golden image that a file holds, for any driver."""
    return Golden(path.parent, path.stem.partition("@")[0], path.suffix)
