"""Mitsuba as it is loaded."""

import os
import subprocess
import sys

import pytest

LOAD = "from gsgi.baker.trace.mitsuba_scene import load_mitsuba; load_mitsuba()"


def loaded(**environment: str) -> str:
    """What a process that loads Mitsuba prints on stderr."""
    others = {name: value for name, value in os.environ.items() if name not in ("HOME", "DRJIT_CACHE_DIR")}
    command = [sys.executable, "-c", LOAD]
    return subprocess.run(command, env=others | environment, stderr=subprocess.PIPE, text=True, check=True).stderr


@pytest.mark.parametrize("home", [{}, {"HOME": "/proc"}], ids=["missing", "read-only"])
def test_a_home_that_cannot_be_written_is_no_news(home):
    assert loaded(**home) == ""


def test_a_folder_for_kernels_that_was_asked_for_is_named_where_it_does_not_work():
    assert "/proc/kernels" in loaded(HOME="/proc", DRJIT_CACHE_DIR="/proc/kernels")
