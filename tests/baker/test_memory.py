"""How much memory a picture takes and how much there is."""

import resource
from pathlib import Path

import pytest

from gsgi.baker import memory
from gsgi.runtime.errors import GsgiError


def test_a_picture_that_does_not_fit_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 10**9)
    assert memory.check_picture((1000, 1000), 150) == "a picture of 1000 x 1000 px takes about 150 MB of memory"
    with pytest.raises(GsgiError, match=r"8192 x 8192 px takes about 10\.1 GB of memory, and 1\.0 GB are available"):
        memory.check_picture((8192, 8192), 150)
    assert GsgiError.exit_code == 4


def test_where_the_system_does_not_say_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: None)
    assert "8192 x 8192" in memory.check_picture((8192, 8192), 150)


def test_no_more_is_available_than_the_machine_and_the_limits_allow(monkeypatch):
    total = next(line for line in Path("/proc/meminfo").read_text().splitlines() if line.startswith("MemTotal"))
    assert 0 < memory.available() <= 1024 * int(total.split()[1])
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (used + (64 << 20), -1))
    assert 0 < memory.available() <= 64 << 20
