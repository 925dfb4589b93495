"""Time the stages of a bake and report them to a display. Nothing is printed here."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol


class Bar(Protocol):
    """Shows one stage.

    `advance(amount, note)` is called as the work proceeds, then `finish(seconds)`, or `stop` if the stage failed.
    """

    def advance(self, amount: float = 1, note: str = "") -> None: ...

    def stop(self) -> None: ...

    def finish(self, seconds: float) -> None: ...


class Display(Protocol):
    """Shows stages, each with its total amount of work in some unit (0: unknown), log lines and warnings."""

    def begin(self, name: str, total: float, unit: str) -> Bar: ...

    def say(self, line: str) -> None: ...

    def warn(self, line: str) -> None: ...


class Silent:
    """A display that shows nothing; it is also its own bar."""

    def begin(self, name: str, total: float, unit: str) -> "Silent":
        """Return itself."""
        return self

    def say(self, line: str) -> None:
        """Show nothing."""

    def warn(self, line: str) -> None:
        """Show nothing."""

    def advance(self, amount: float = 1, note: str = "") -> None:
        """Show nothing."""

    def stop(self) -> None:
        """Show nothing."""

    def finish(self, seconds: float) -> None:
        """Show nothing."""


class Progress:
    """Times stages in `seconds` (name -> s), keeps `warnings`, and passes everything on to `display`."""

    def __init__(self, display: Display | None = None):
        self._began = time.perf_counter()
        self.seconds: dict[str, float] = {}
        self.warnings: list[str] = []
        self._display, self._prefix = display or Silent(), ""
        self._whole: Progress | None = None

    def part(self, name: str) -> "Progress":
        """The progress of a part of the work, whose lines begin with its name. What it keeps is kept here too."""
        part = Progress(self._display)
        part._prefix, part._whole = f"{self._prefix}{name}: ", self
        return part

    @property
    def elapsed(self) -> float:
        """Seconds since the progress was made, which is when the work began."""
        return time.perf_counter() - self._began

    @contextmanager
    def stage(self, name: str, total: float = 0, unit: str = "") -> Iterator[Callable[..., None]]:
        """Time a stage. Yields `advance(amount, note="")`, which reports progress towards `total` units."""
        start = time.perf_counter()
        bar = self._display.begin(name, total, unit)
        try:
            yield bar.advance
        except BaseException:
            bar.stop()
            raise
        seconds = time.perf_counter() - start
        self._took(name, seconds)
        bar.finish(seconds)

    def say(self, line: str) -> None:
        """Show one log line."""
        self._display.say(self._prefix + line)

    def warn(self, line: str) -> None:
        """Keep and show a warning. Everything that is left out is reported this way."""
        self._keep(self._prefix + line)
        self._display.warn(self._prefix + line)

    def _took(self, name: str, seconds: float) -> None:
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        if self._whole:
            self._whole._took(name, seconds)

    def _keep(self, warning: str) -> None:
        self.warnings.append(warning)
        if self._whole:
            self._whole._keep(warning)
