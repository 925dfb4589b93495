"""Read files whose names come from untrusted input."""

import stat
from collections.abc import Callable
from pathlib import Path

from .errors import FileError


def read_file(path: Path, check_size: Callable[[int], None] | None = None) -> bytes:
    """All bytes of a regular file. `check_size(bytes)` may raise before the file is read. Raises FileError."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):  # a folder, or a pipe that would block
            raise FileError(f"{path}: cannot read: not a regular file")
        if check_size:
            check_size(status.st_size)
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{path}: cannot read: {reason}") from None


def inside(folder: Path, name: str) -> Path | None:
    """The path of a relative `name` in a resolved folder, or None if it leads outside that folder.

    Raises ValueError, OSError or RuntimeError if `name` is not a valid path (a NUL, a loop of symbolic links).
    """
    path = (folder / name).resolve()
    return None if Path(name).is_absolute() or not path.is_relative_to(folder) else path
