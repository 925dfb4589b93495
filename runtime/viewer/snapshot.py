"""A picture to a file that was not there before."""

from pathlib import Path

import numpy as np

from gsgi.runtime.errors import FileError
from gsgi.runtime.image import write_image


def write_snapshot(name: str, image: np.ndarray) -> Path:
    """Write (H, W, 3) uint8 to NAME-001.png in the current folder, or under the next number that is free.

    Returns the path. Raises FileError, and leaves no file then.
    """
    path = _claim(name)
    try:
        write_image(path, image)
    except FileError:
        path.unlink(missing_ok=True)
        raise
    return path


def _claim(name: str) -> Path:
    """An empty file, made here."""
    number = 1
    while True:
        path = Path(f"{name}-{number:03}.png")
        try:
            path.touch(exist_ok=False)
        except FileExistsError:
            number += 1
        except OSError as error:
            raise FileError(f"{path}: cannot write: {error.strerror or error}") from None
        else:
            return path
