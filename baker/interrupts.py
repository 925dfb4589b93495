"""Calls into libraries that no interrupt may leave half-way."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

SIGNALS = signal.SIGINT, signal.SIGTERM


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let what handles SIGINT and SIGTERM, such as by KeyboardInterrupt, wait for the end of the block.

    For libraries that an exception out of a handler leaves in ruins, and the process with them. Signals are handled by
    the main thread: in any other, nothing has to wait.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting, inside = [], True

    def wait(*arrived) -> None:
        """Also handles what arrives before the handlers are back in their places."""
        if inside:
            waiting.append(arrived)
        else:
            before[arrived[0]](*arrived)

    before = {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}
    try:
        for number in before:
            signal.signal(number, wait)
        yield
    finally:
        inside = False
        for number, handler in before.items():
            signal.signal(number, handler)
        for arrived in waiting[:1]:
            before[arrived[0]](*arrived)
