"""Reads sectors in a thread of its own, one at a time."""

import queue
import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


class Loader:
    """Calls `read(number)` in a thread, so that no frame waits for a disk."""

    def __init__(self, read: Callable[[int], T]):
        self._read, self.busy = read, False
        self._asked: queue.SimpleQueue[int | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[tuple[int, T | Exception]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="gsgi.World", daemon=True)
        self._thread.start()

    def load(self, number: int) -> None:
        """Ask for one; nothing else may be asked for until it is `finished`."""
        assert not self.busy, number
        self.busy = True
        self._asked.put(number)

    def finished(self) -> tuple[int, T | Exception] | None:
        """The number and what was read, or what reading raised, once; None if nothing is ready."""
        try:
            result = self._done.get_nowait()
        except queue.Empty:
            return None
        self.busy = False
        return result

    def close(self) -> None:
        """End the thread."""
        self._asked.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (number := self._asked.get()) is not None:
            self._done.put((number, attempt(self._read, number)))


def attempt(read: Callable[[int], T], number: int) -> T | Exception:
    """What `read` returns, or what it raises."""
    try:
        return read(number)
    except Exception as error:
        return error
