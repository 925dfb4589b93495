"""Do two things at once."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

One, Other = TypeVar("One"), TypeVar("Other")


def together(one: Callable[[], One], other: Callable[[], Other]) -> tuple[One, Other]:
    """The results of two functions; a thread calls `one` while the caller's own calls `other`."""
    with ThreadPoolExecutor(1) as pool:
        working = pool.submit(one)
        done = other()
        return working.result(), done
