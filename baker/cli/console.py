"""Progress of a command on stderr: a bar per stage on a terminal, plain lines elsewhere."""

import os
import sys
import time

from gsgi.baker.progress import Bar, Silent

LINE_INTERVAL = 60.0  # s between plain lines of one stage; few lines, because a log is read afterwards


def tell(line: str) -> None:
    """Print a line on stderr.

    Where that fails (`2>&1 | head`, a full disk) the rest of the log is lost, but no bake.
    """
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


class Console:
    """Shows progress on stderr; with `quiet`, only warnings and the closing line."""

    def __init__(self, quiet: bool = False):
        self.quiet = quiet

    def begin(self, name: str, total: float, unit: str) -> Bar:
        """Return the bar of a stage."""
        if self.quiet:
            return Silent()
        return _Terminal(name, total, unit) if sys.stderr.isatty() else _Lines(name, total, unit)

    def say(self, line: str) -> None:
        """Print one log line above the bar."""
        if not self.quiet:
            self.close(line)

    def warn(self, line: str) -> None:
        """Print a warning, quiet or not."""
        tell(f"warning: {line}")

    def close(self, line: str) -> None:
        """Print the line that says what was done, quiet or not."""
        if sys.stderr.isatty() and not self.quiet:
            from tqdm import tqdm

            tqdm.write(line, file=sys.stderr)
        else:
            tell(line)


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
    """Prints one line when the stage ends, and one every LINE_INTERVAL until then."""

    def __init__(self, name: str, total: float, unit: str):
        self.name, self.total, self.unit = name, total, unit
        self.done, self.note, self.last = 0.0, "", time.perf_counter()
        self.paced = None  # time and amount of the first advance, which may come from a cache

    def advance(self, amount: float = 1, note: str = "") -> None:
        self.done, self.note = self.done + amount, note or self.note
        self.paced = self.paced or (time.perf_counter(), self.done)
        if time.perf_counter() - self.last >= LINE_INTERVAL:
            self.last = time.perf_counter()
            of = f"{self.done:.0f}/{self.total:.0f} {self.unit}{self._left()}" if self.total else ""
            tell(f"{self.name:<11} {of} {self.note}".rstrip())

    def _left(self) -> str:
        """Remaining time at the pace so far, as text; empty if unknown."""
        start, before = self.paced
        if not before < self.done <= self.total:
            return ""
        return f", {(self.total - self.done) / (self.done - before) * (self.last - start):.0f} s left,"

    def stop(self) -> None:
        """Print nothing for a stage that failed: the error has its own line."""

    def finish(self, seconds: float) -> None:
        what = f"{self.total:.0f} {self.unit}, " if self.total else ""
        tell(f"{self.name:<11} {what}{seconds:.1f} s {self.note}".rstrip())
