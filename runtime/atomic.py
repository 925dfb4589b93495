"""Write files atomically: as a whole or not at all."""

import errno
import os
import shutil
import stat
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from .errors import FileError, UsageError

LEFTOVER_AGE = 24 * 3600  # s; a temporary file this old belongs to a run that was killed

_unfinished: set[Path] = set()


def check_apart(path: str | Path, others: Iterable[str | Path]) -> None:
    """Raise UsageError if a file that is to be written is one of others, which are read or written too."""
    if Path(path).resolve() in {Path(file).resolve() for file in others}:
        raise UsageError(f"{path}: would overwrite another file of this command")


def write_atomic(path: str | Path, data: bytes) -> None:
    """Write `data` to `path` atomically: readers see the old file or the new one, even after a kill at any moment.

    Raises FileError, which names the path and, if the disk is full, the disk.
    """
    write_together({path: data})


def write_together(contents: Mapping[str | Path, bytes]) -> None:
    """Write each file as `write_atomic` does; the first file is replaced last, after all others.

    If the first file is new, so are the others. If any file cannot be written, the first one stays as it was. Raises
    FileError.
    """
    with ExitStack() as written:
        for path, data in contents.items():
            with open(written.enter_context(replacing(path)), "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())  # a full disk may be reported only here


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a fresh name in the folder of `path`; the file that the block writes there replaces `path` at its end.

    If the block raises, `path` stays as it was. An OSError becomes a FileError that names the path.
    """
    try:
        target = Path(path).resolve()  # follows symbolic links, which are kept
    except RuntimeError:  # raised for a loop of symbolic links
        raise FileError(f"{path}: cannot write: too many levels of symbolic links") from None
    temporary = target.with_name(f".gsgi-{uuid.uuid4().hex}.tmp")
    _unfinished.add(temporary)
    try:
        if not _is_regular_or_absent(target):  # a folder, or a device like /dev/null
            raise FileError(f"{path}: cannot write: not a regular file")
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        raise FileError(f"{path}: cannot write: {_reason(error, target.parent)}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()
        _unfinished.discard(temporary)


def check_writable(path: str | Path) -> None:
    """Raise the FileError that writing `path` would raise, as far as this can be known in advance.

    Also removes the temporary files that killed runs left in its folder.
    """

    class OnlyCheckingError(Exception):
        pass

    with suppress(OnlyCheckingError), replacing(path) as temporary:
        temporary.touch()
        remove_leftovers(temporary.parent, LEFTOVER_AGE)
        raise OnlyCheckingError  # leaves `replacing` before it replaces anything


def remove_leftovers(folder: Path, age: float) -> None:
    """Remove the temporary files of this module in `folder` that were last written more than `age` (s) ago."""
    for path in folder.glob(f".gsgi-{'[0-9a-f]' * 32}.tmp"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > age:
                path.unlink()


def discard_unfinished() -> None:
    """Remove the files that this process has not finished writing, because it is about to end."""
    for temporary in tuple(_unfinished):
        with suppress(OSError):
            temporary.unlink()


def _is_regular_or_absent(path: Path) -> bool:
    """Looks once: another process may remove the file at any moment."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return True


def _reason(error: OSError, folder: Path) -> str:
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return error.strerror or str(error)
    disk = next(parent for parent in (folder, *folder.parents) if os.path.ismount(parent))
    return f"{error.strerror}: {shutil.disk_usage(folder).free} bytes are free on the disk at {disk}"
