"""Progress: stages are timed, warnings are kept, and nothing is printed."""

import pytest

from gsgi.baker.progress import Progress, Silent


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


def test_a_part_has_its_own_figures_and_adds_to_those_of_the_whole():
    said = []
    display = Silent()
    display.say = said.append
    whole = Progress(display)
    for name in ("sector 1/2", "sector 2/2"):
        part = whole.part(name)
        with part.stage("fit"):
            pass
        part.say("done")
        part.warn("dark")
        assert part.warnings == [f"{name}: dark"]
        assert list(part.seconds) == ["fit"]
    assert said == ["sector 1/2: done", "sector 2/2: done"]
    assert whole.warnings == ["sector 1/2: dark", "sector 2/2: dark"]
    assert whole.seconds["fit"] > part.seconds["fit"]
