"""Screenshots of a whole run: the report, and the lines at the end of the run."""

import re
from pathlib import Path

import pytest

from .golden import golden_in, unused
from .record import Record, records_in
from .report import html

REPORT = "report.html"
# Pictures that failures of any run leave beside the report (see ScreenshotAssertion).
_PICTURE = re.compile(r".+-[0-9a-f]{8}-(actual|expected|difference)\.(png|exr)")


class Collector:
    """Plugin for the process that reports. It gathers the records of all tests, including those of other processes."""

    def __init__(self, config: pytest.Config, output: Path):
        self.root, self.output = config.rootpath, output
        self.records: list[Record] = []
        self.unreported = ""  # why there is no report of what failed
        self.finished: dict[str, bool] = {}  # test file: whether all of its tests ended and passed
        option = config.option
        # Options that select tests. Golden images of the tests left out are in use, too.
        selected = (getattr(option, name, None) for name in ("keyword", "markexpr", "deselect", "lf", "collectonly"))
        self.whole = not any(selected) and not any("::" in argument for argument in config.args)

    def pytest_deselected(self, items) -> None:
        self.whole = self.whole and not items

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        file = report.nodeid.partition("::")[0]
        self.finished[file] = self.finished.get(file, True) and report.passed
        if report.when == "teardown":
            self.records += records_in(report.user_properties)

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        ended = exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
        self.whole = self.whole and ended and not session.shouldstop and not session.shouldfail
        if not self.records:
            return
        if self._fought_over():
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        try:
            self._report(self._of("failed"))
        except OSError as error:
            self.unreported = f", and no report: {error}"

    def _report(self, failed: list[Record]) -> None:
        """Write the report of failures, if there are some, and remove what earlier runs left."""
        kept = {Path(path).name for record in failed for path in record.pictures.values()}
        for path in self.output.glob("*"):
            if path.name == REPORT or (_PICTURE.fullmatch(path.name) and path.name not in kept):
                path.unlink()
        if failed:
            (self.output / REPORT).write_text(html(self.records, self.root), encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        written, failed, idle = self._of("written"), self._of("failed"), self._unused()
        if not (written or failed or idle):
            return
        terminalreporter.section("screenshots")
        for record in written:
            terminalreporter.line(f"golden image written: {record.used}")
        for path, tests in self._fought_over().items():
            terminalreporter.line(f"ERROR: {path} was written by each of {', '.join(tests)}: name them apart", red=True)
        if failed:
            terminalreporter.line(f"{len(failed)} failed{self.unreported or f': {self.output / REPORT}'}")
        for path in idle:
            terminalreporter.line(f"golden image that no test asked for: {path.relative_to(self.root)}")

    def _of(self, outcome: str) -> list[Record]:
        return [record for record in self.records if record.outcome == outcome]

    def _fought_over(self) -> dict[str, list[str]]:
        """Golden images that several comparisons have written, each over that of another, with their tests."""
        tests: dict[str, list[str]] = {}
        for record in self._of("written"):
            tests.setdefault(record.used, []).append(record.test)
        return {path: each for path, each in tests.items() if len(each) > 1}

    def _unused(self) -> list[Path]:
        """Golden images without a test, as far as this run can tell. Empty if the run left tests out."""
        if not (self.whole and self.records):
            return []
        files = {self.root / file for file, finished in self.finished.items() if finished}
        return unused(files, {golden_in(self.root / record.golden) for record in self.records})
