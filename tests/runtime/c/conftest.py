"""The shared library, built once, a context of it, and a host."""

import re
import struct
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from c_library import Context, Library, build
from host import Host
from repository import TESTS


@pytest.fixture(scope="session")
def shared_build(tmp_path_factory) -> Path:
    """Build folder of the shared library."""
    folder = tmp_path_factory.mktemp("gsgi")
    return build(folder, "-DBUILD_SHARED_LIBS=ON", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_INSTALL_LIBDIR=lib")


@pytest.fixture(scope="session")
def library(shared_build) -> Library:
    return Library(shared_build / "libgsgi.so")


@pytest.fixture(scope="session")
def sanitized(tmp_path_factory) -> Callable[[str, Sequence[bytes]], int]:
    """Runs a program of fuzz/ over files, under sanitizers; returns how many were opened, and not refused."""
    folder = build(tmp_path_factory.mktemp("fuzz"), source=TESTS / "runtime" / "c" / "fuzz")

    def run(program: str, corpus: Sequence[bytes]) -> int:
        files = folder / "corpus"
        files.write_bytes(b"".join(struct.pack("<I", len(data)) + data for data in corpus))
        done = subprocess.run([folder / program, files], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return int(re.fullmatch(r"(\d+) opened, (\d+) refused\n", done.stdout)[1])

    return run


@pytest.fixture
def context(library, gl):
    made = Context(library, gl)
    yield made
    made.destroy()


@pytest.fixture(scope="module")
def host(gl) -> Host:
    return Host(gl)
