"""Write a folder as a whole or not at all."""

import json
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gsgi.runtime.errors import FileError, UsageError

from .page import DESCRIPTION, GENERATOR

LEFTOVER_AGE = 24 * 3600  # s; a temporary folder this old belongs to a run that was killed


def check_folder(path: str | Path) -> None:
    """Raise UsageError if `path` must not be replaced: if it is neither a page of ours nor an empty folder."""
    path = Path(path)
    if not os.path.lexists(path):
        return
    try:
        ours = path.is_dir() and (not any(path.iterdir()) or _is_page(path))
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    if not ours:
        raise UsageError(f"--web {path}: exists, and is neither empty nor a page that gsgi has written")


@contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """Yield an empty folder that replaces the folder `path` at the end of the block.

    If the block raises, `path` stays as it was. A process that is killed between the two renames leaves the old folder
    beside, as `.gsgi-NAME.old`; the next call puts it back first. Raises UsageError as check_folder() does, and
    FileError.
    """
    target = Path(path).resolve()
    new, old = target.with_name(f".gsgi-{uuid.uuid4().hex}.dir"), target.with_name(f".gsgi-{target.name}.old")
    try:
        _put_back(old, target)
        check_folder(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(target.parent)
        new.mkdir()
        yield new
        check_folder(path)
        with suppress(FileNotFoundError):
            target.rename(old)
        new.rename(target)
    except OSError as error:
        raise FileError(f"{path}: cannot write: {error.strerror or error}") from None
    finally:
        shutil.rmtree(new, ignore_errors=True)
        with suppress(OSError):
            _put_back(old, target)


def _put_back(old: Path, target: Path) -> None:
    """Rename `old` to `target` if there is no `target`, else remove it. Raises OSError."""
    if not os.path.lexists(target):
        with suppress(FileNotFoundError):
            old.rename(target)
    shutil.rmtree(old, ignore_errors=True)


def _is_page(folder: Path) -> bool:
    try:
        return json.loads((folder / DESCRIPTION).read_bytes())["generator"] == GENERATOR
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _remove_leftovers(folder: Path) -> None:
    for path in folder.glob(f".gsgi-{'[0-9a-f]' * 32}.dir"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > LEFTOVER_AGE:
                shutil.rmtree(path)
