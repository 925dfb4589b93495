"""What a command shows while it works: plain lines off a terminal, next to nothing when quiet."""

import pytest

from gsgi.baker.cli.console import LINE_INTERVAL, Console
from gsgi.baker.progress import Progress


def test_a_stage_is_reported_in_one_line(capsys):
    with Progress(Console()).stage("fit", 10, "iterations") as advance:
        advance(10, "loss 0.1")
    line = capsys.readouterr().err
    assert line.startswith("fit         10 iterations, ")
    assert line.endswith("s loss 0.1\n")


def test_quiet_says_nothing_but_warnings_and_the_closing_line(capsys):
    console = Console(quiet=True)
    progress = Progress(console)
    with progress.stage("fit"):
        progress.say("hello")
    assert capsys.readouterr() == ("", "")
    progress.warn("glass is left out")
    console.close("wrote room.gsgi")
    assert capsys.readouterr().err == "warning: glass is left out\nwrote room.gsgi\n"


def test_a_stage_that_fails_is_not_reported_as_done(capsys):
    with pytest.raises(ValueError, match="broken"), Progress(Console()).stage("fit", 10):
        raise ValueError("broken")
    assert capsys.readouterr().err == ""


def test_a_long_stage_says_how_far_it_is_once_a_minute(capsys, monkeypatch):
    """The rest is estimated from the pace since the first part, which may come from a cache."""
    now = [0.0]
    monkeypatch.setattr("gsgi.baker.progress.time.perf_counter", lambda: now[0])
    with Progress(Console()).stage("fit", 10, "iterations") as advance:
        advance(4)
        now[0] = 0.5 * LINE_INTERVAL
        advance(1)
        assert capsys.readouterr().err == ""
        now[0] = LINE_INTERVAL
        advance(1, "loss 0.1")
        assert capsys.readouterr().err == "fit         6/10 iterations, 120 s left, loss 0.1\n"
