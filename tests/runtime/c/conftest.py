"""The shared library, built once, a context of it, and a host."""

from pathlib import Path

import pytest
from c_library import Context, Library, build
from host import Host


@pytest.fixture(scope="session")
def shared_build(tmp_path_factory) -> Path:
    """Build folder of the shared library."""
    folder = tmp_path_factory.mktemp("gsgi")
    return build(folder, "-DBUILD_SHARED_LIBS=ON", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_INSTALL_LIBDIR=lib")


@pytest.fixture(scope="session")
def library(shared_build) -> Library:
    return Library(shared_build / "libgsgi.so")


@pytest.fixture
def context(library, gl):
    made = Context(library, gl)
    yield made
    made.destroy()


@pytest.fixture(scope="module")
def host(gl) -> Host:
    return Host(gl)
