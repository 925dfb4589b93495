"""Picture files that never replace existing files."""

from pathlib import Path

import numpy as np

from gsgi.runtime.errors import FileError
from gsgi.runtime.image import write_image


def write_snapshot(name: str, image: np.ndarray) -> Path:
    """Write (H, W, 3) uint8 to NAME-001.png in the current folder, or to the next number that is free.

    Returns the path. Raises FileError, and then leaves no file.
    """
    path = _claim(name)
    try:
        write_image(path, image)
    except FileError:
        path.unlink(missing_ok=True)
        raise
    return path


def _claim(name: str) -> Path:
    """Create an empty file under the first free number."""
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
