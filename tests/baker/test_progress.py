"""Progress: stages are timed, warnings are kept, and nothing is printed."""

import pytest

from gsgi.baker.progress import Progress


def test_a_stage_is_timed_and_says_nothing(capsys):
    progress = Progress()
    with progress.stage("fit", 10, "iterations") as advance:
        advance(10, "loss 0.1")
        progress.say("hello")
    assert list(progress.seconds) == ["fit"]
    assert progress.seconds["fit"] >= 0
    assert capsys.readouterr() == ("", "")


def test_warnings_are_kept(capsys):
    progress = Progress()
    progress.warn("glass is left out")
    assert progress.warnings == ["glass is left out"]
    assert capsys.readouterr() == ("", "")


def test_a_stage_that_fails_has_no_seconds():
    progress = Progress()
    with pytest.raises(ValueError, match="broken"), progress.stage("fit", 10):
        raise ValueError("broken")
    assert progress.seconds == {}
