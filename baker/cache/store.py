"""Finished tasks on disk: computed once and found again when the same task is needed."""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsgi.runtime.atomic import LEFTOVER_AGE, remove_leftovers, replacing
from gsgi.runtime.errors import FileError, UsageError

from .digest import digest
from .task_file import pack, unpack

LIMIT = "4GiB"
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kmgt]?)(i?)b")
_NAME = re.compile(r"([a-z]+)-[0-9a-f]{40}\.gsgi-task")


def default_folder() -> Path:
    """The folder GSGI_CACHE, else gsgi in XDG_CACHE_HOME, else ~/.cache/gsgi."""
    if chosen := os.environ.get("GSGI_CACHE"):
        return Path(chosen)
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path(os.path.expanduser("~"), ".cache")) / "gsgi"


def size_limit() -> int:
    """Bytes that GSGI_CACHE_LIMIT gives, such as 500MB or 10GiB, else LIMIT. Raises UsageError."""
    text = os.environ.get("GSGI_CACHE_LIMIT") or LIMIT
    match = _SIZE.fullmatch(text.lower())
    if not match:
        raise UsageError(f"GSGI_CACHE_LIMIT: expected a size such as 500MB or 10GiB, got {text!r}")
    number, prefix, binary = match.groups()
    return int(float(number) * (1024 if binary else 1000) ** " kmgt".index(prefix or " "))


def task_key(stage: str, **inputs) -> str:
    """The name of a task: its stage (a lower-case word) and the digest of everything that its result depends on."""
    return f"{stage}-{digest(inputs)}"


@dataclass(frozen=True)
class Entry:
    """One file of a cache. `used` is the time when it was last read or written (s since 1970)."""

    path: Path
    stage: str
    bytes: int
    used: float


def entries(folder: Path) -> list[Entry]:
    """All entries in a cache folder, least recently used first; none if there is no folder. Raises FileError."""
    found = []
    try:
        for path in folder.iterdir():
            if match := _NAME.fullmatch(path.name):
                with suppress(FileNotFoundError):  # another bake has just removed it
                    status = path.stat()
                    found.append(Entry(path, match[1], status.st_size, status.st_mtime))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise FileError(f"{folder}: cannot read: {error.strerror or error}") from None
    return sorted(found, key=lambda entry: (entry.used, entry.path))


def clear(folder: Path) -> None:
    """Remove all entries and temporary files, but no other files. Raises FileError."""
    for entry in entries(folder):
        try:
            entry.path.unlink(missing_ok=True)
        except OSError as error:
            raise FileError(f"{entry.path}: cannot remove: {error.strerror or error}") from None
    remove_leftovers(folder, age=0)


class Cache:
    """The tasks in one folder. Without a folder, the cache is always empty.

    No method fails. An entry that is damaged or cannot be read counts as absent. After the first entry that cannot be
    written, `warn(line)` is called and nothing more is written. Several processes may share a folder.
    """

    def __init__(self, folder: Path | None = None, limit: int = 0, warn: Callable[[str], None] = lambda line: None):
        self.folder, self.limit, self.warn = folder, limit, warn
        self.used: set[str] = set()  # keys that were found or put
        self._writes = folder is not None

    def get(self, key: str) -> dict[str, np.ndarray] | None:
        """The arrays that were put under `key`, or None."""
        data = self.packed(key)
        arrays = None if data is None else unpack(key, data)
        if arrays is not None:
            self.used.add(key)
        return arrays

    def packed(self, key: str) -> bytes | None:
        """The bytes of the entry under `key`, which may be damaged, or None."""
        if self.folder is None:
            return None
        path = self._path(key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        with suppress(OSError):  # the folder may be read-only
            os.utime(path)
        return data

    def put(self, key: str, arrays: dict[str, np.ndarray]) -> None:
        """Keep arrays under `key`, in place of those that were there."""
        if self._writes:
            self.keep(key, pack(key, arrays))

    def keep(self, key: str, data: bytes) -> None:
        """Keep the bytes of an entry under `key`."""
        if not self._writes:
            return
        path = self._path(key)
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with replacing(path) as temporary:
                temporary.write_bytes(data)
        except OSError as error:
            self._stop(f"{self.folder}: cannot write: {error.strerror or error}")
        except FileError as error:
            self._stop(str(error))
        else:
            self.used.add(key)

    def holds(self, key: str) -> bool:
        """Whether there is an entry under `key`; it may be damaged."""
        return self.folder is not None and self._path(key).is_file()

    def remove(self, key: str) -> None:
        """Remove the entry under `key`."""
        self.used.discard(key)
        if self._writes:
            with suppress(OSError):
                self._path(key).unlink()

    @contextmanager
    def recording(self) -> Iterator[set[str]]:
        """Yield a set that has the keys of all entries that the block found or put, once it ends."""
        before, self.used = self.used, set()
        try:
            yield (used := self.used)
        finally:
            self.used = before | used

    def trim(self) -> None:
        """Remove old leftovers, and the least recently used entries beyond the limit that this run did not use."""
        if not self._writes:
            return
        with suppress(OSError, FileError):
            remove_leftovers(self.folder, LEFTOVER_AGE)
            kept = entries(self.folder)
            excess = sum(entry.bytes for entry in kept) - self.limit
            for entry in kept:
                if excess > 0 and entry.path.stem not in self.used:
                    entry.path.unlink(missing_ok=True)
                    excess -= entry.bytes

    def _path(self, key: str) -> Path:
        path = self.folder / f"{key}.gsgi-task"
        assert _NAME.fullmatch(path.name), key
        return path

    def _stop(self, reason: str) -> None:
        self._writes = False
        self.warn(f"{reason}; the bake goes on and the cache keeps nothing more of it")


class MemoryCache(Cache):
    """Tasks in the memory of this process alone, of which nothing is left when it ends."""

    def __init__(self):
        super().__init__()
        self._writes, self._entries = True, {}

    def packed(self, key: str) -> bytes | None:
        """The bytes of the entry under `key`, or None."""
        return self._entries.get(key)

    def keep(self, key: str, data: bytes) -> None:
        """Keep the bytes of an entry under `key`."""
        self._entries[key] = data
        self.used.add(key)

    def holds(self, key: str) -> bool:
        """Whether there is an entry under `key`."""
        return key in self._entries

    def remove(self, key: str) -> None:
        """Remove the entry under `key`."""
        self.used.discard(key)
        self._entries.pop(key, None)
