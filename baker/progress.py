"""What a bake says while it works: a bar per stage on a terminal, plain lines otherwise; and seconds per stage."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Seconds between plain lines of one stage.
LINE_INTERVAL = 10.0


class Progress:
    """Times stages in `seconds` (name -> s) and, unless `quiet`, reports them on stderr."""

    def __init__(self, quiet: bool = False):
        self.seconds: dict[str, float] = {}
        self.quiet = quiet

    @contextmanager
    def stage(self, name: str, total: float = 0, unit: str = "") -> Iterator[Callable[..., None]]:
        """Run a stage. Yields `advance(amount, note="")`, to be called as the work goes on towards `total` units."""
        start = time.perf_counter()
        bar = self._bar(name, total, unit)
        try:
            yield bar.advance
        except BaseException:
            bar.stop()
            raise
        seconds = time.perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        bar.finish(seconds)

    def say(self, line: str) -> None:
        """Print one line of the log on stderr, above the bar."""
        if self.quiet:
            return
        if sys.stderr.isatty():
            from tqdm import tqdm

            tqdm.write(line, file=sys.stderr)
        else:
            print(line, file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """Print a warning on stderr, quiet or not: what is left out is never left out silently."""
        print(f"warning: {line}", file=sys.stderr, flush=True)

    def _bar(self, name: str, total: float, unit: str):
        if self.quiet:
            return _Silent()
        return _Terminal(name, total, unit) if sys.stderr.isatty() else _Lines(name, total, unit)


class _Silent:
    def advance(self, amount: float = 1, note: str = "") -> None:
        """Nothing to show."""

    def stop(self) -> None:
        """Nothing to show."""

    def finish(self, seconds: float) -> None:
        """Nothing to show."""


class _Terminal:
    def __init__(self, name: str, total: float, unit: str):
        from tqdm import tqdm

        shape = "{desc:<11} {percentage:3.0f}% |{bar:24}| {n:.0f}/{total:.0f}{unit} [{elapsed}<{remaining}]{postfix}"
        waiting = "{desc:<11} {elapsed}{postfix}"
        form = shape if total else waiting
        self.bar = tqdm(total=total or None, desc=name, unit=f" {unit}", bar_format=form, leave=True)

    def advance(self, amount: float = 1, note: str = "") -> None:
        self.bar.update(amount)
        if note:
            self.bar.set_postfix_str(note, refresh=False)

    def stop(self) -> None:
        self.bar.leave = False
        self.bar.close()

    def finish(self, seconds: float) -> None:
        self.bar.close()


class _Lines:
    def __init__(self, name: str, total: float, unit: str):
        self.name, self.total, self.unit = name, total, unit
        self.done, self.note, self.last = 0.0, "", time.perf_counter()
        self.paced = None  # when the first part was done, and how much that was: it may come from a cache

    def advance(self, amount: float = 1, note: str = "") -> None:
        self.done, self.note = self.done + amount, note or self.note
        self.paced = self.paced or (time.perf_counter(), self.done)
        if time.perf_counter() - self.last >= LINE_INTERVAL:
            self.last = time.perf_counter()
            of = f"{self.done:.0f}/{self.total:.0f} {self.unit}{self._left()}" if self.total else ""
            print(f"{self.name:<11} {of} {self.note}".rstrip(), file=sys.stderr, flush=True)

    def _left(self) -> str:
        """How long the rest takes at the pace so far."""
        start, before = self.paced
        if not before < self.done <= self.total:
            return ""
        return f", {(self.total - self.done) / (self.done - before) * (self.last - start):.0f} s left,"

    def stop(self) -> None:
        """A stage that did not end has no line: the error has its own."""

    def finish(self, seconds: float) -> None:
        what = f"{self.total:.0f} {self.unit}, " if self.total else ""
        print(f"{self.name:<11} {what}{seconds:.1f} s {self.note}".rstrip(), file=sys.stderr, flush=True)
