"""The stages of a bake: how long each takes, and who is told of them. Nothing is printed here."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol


class Bar(Protocol):
    """What shows one stage. `advance(amount, note)` is called as the work goes on, then either `stop`, where the stage
    failed, or `finish(seconds)`."""

    def advance(self, amount: float = 1, note: str = "") -> None: ...

    def stop(self) -> None: ...

    def finish(self, seconds: float) -> None: ...


class Display(Protocol):
    """Who is told: of each stage with its total of work in some unit (0: unknown), of lines for the log, of warnings."""

    def begin(self, name: str, total: float, unit: str) -> Bar: ...

    def say(self, line: str) -> None: ...

    def warn(self, line: str) -> None: ...


class Silent:
    """A display that shows nothing, and its bar."""

    def begin(self, name: str, total: float, unit: str) -> "Silent":
        """Itself."""
        return self

    def say(self, line: str) -> None:
        """Nothing is shown."""

    def warn(self, line: str) -> None:
        """Nothing is shown."""

    def advance(self, amount: float = 1, note: str = "") -> None:
        """Nothing is shown."""

    def stop(self) -> None:
        """Nothing is shown."""

    def finish(self, seconds: float) -> None:
        """Nothing is shown."""


class Progress:
    """Times stages in `seconds` (name -> s), keeps `warnings`, and passes everything on to `display`."""

    def __init__(self, display: Display | None = None):
        self.seconds: dict[str, float] = {}
        self.warnings: list[str] = []
        self._display = display or Silent()

    @contextmanager
    def stage(self, name: str, total: float = 0, unit: str = "") -> Iterator[Callable[..., None]]:
        """Run a stage. Yields `advance(amount, note="")`, to be called as the work goes on towards `total` units."""
        start = time.perf_counter()
        bar = self._display.begin(name, total, unit)
        try:
            yield bar.advance
        except BaseException:
            bar.stop()
            raise
        seconds = time.perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        bar.finish(seconds)

    def say(self, line: str) -> None:
        """One line for the log."""
        self._display.say(line)

    def warn(self, line: str) -> None:
        """A warning: whatever is left out is reported."""
        self.warnings.append(line)
        self._display.warn(line)
