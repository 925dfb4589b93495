"""Write a file as a whole or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import FileError


def write_atomic(path: str | Path, data: bytes) -> None:
    """Write `data` to `path`; whoever reads it, or a kill at any moment, sees the old file or the new one.

    Raises FileError with the path.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A fresh name in the folder of `path`: what the block writes there takes the place of `path` at its end.

    If the block raises, `path` stays as it was. An OSError becomes a FileError with the path.
    """
    try:
        target = Path(path).resolve()  # through links, which stay
    except RuntimeError:  # Python's word for a loop of links
        raise FileError(f"{path}: cannot write: too many levels of symbolic links") from None
    temporary = target.with_name(f".gsgi-{uuid.uuid4().hex}.tmp")
    try:
        if target.exists() and not target.is_file():  # a folder, or a device like /dev/null
            raise FileError(f"{path}: cannot write: not a regular file")
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        raise FileError(f"{path}: cannot write: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def check_writable(path: str | Path) -> None:
    """Raise the FileError that writing `path` would end in, as far as can be told before the work is done."""

    class OnlyCheckingError(Exception):
        pass

    with suppress(OnlyCheckingError), replacing(path) as temporary:
        temporary.touch()
        raise OnlyCheckingError  # leaves `replacing` before it replaces anything
