"""What a bake says: plain lines off a terminal, nothing when quiet, no summary of a stage that failed."""

import pytest

from gsgi.baker.progress import Progress


def test_a_stage_is_timed_and_reported_in_one_line(capsys):
    progress = Progress()
    with progress.stage("fit", 10, "iterations") as advance:
        advance(10, "loss 0.1")
    assert list(progress.seconds) == ["fit"]
    line = capsys.readouterr().err
    assert line.startswith("fit         10 iterations, ")
    assert line.endswith("s loss 0.1\n")


def test_quiet_says_nothing_and_still_times(capsys):
    progress = Progress(quiet=True)
    with progress.stage("fit"):
        progress.say("hello")
    assert progress.seconds["fit"] >= 0
    assert capsys.readouterr() == ("", "")


def test_warnings_are_said_even_when_quiet(capsys):
    Progress(quiet=True).warn("glass is left out")
    assert capsys.readouterr().err == "warning: glass is left out\n"


def test_a_stage_that_fails_is_not_reported_as_done(capsys):
    progress = Progress()
    with pytest.raises(ValueError, match="broken"), progress.stage("fit", 10):
        raise ValueError("broken")
    assert progress.seconds == {}
    assert capsys.readouterr().err == ""


def test_a_long_stage_says_how_far_it_is_and_how_long_the_rest_takes(capsys, monkeypatch):
    """At the pace since the first part, which may come from a cache."""
    now = [0.0]
    monkeypatch.setattr("gsgi.baker.progress.time.perf_counter", lambda: now[0])
    with Progress().stage("fit", 10, "iterations") as advance:
        advance(4)
        now[0] = 20.0
        advance(2, "loss 0.1")
        assert capsys.readouterr().err == "fit         6/10 iterations, 40 s left, loss 0.1\n"
