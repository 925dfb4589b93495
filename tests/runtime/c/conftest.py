"""The shared library, built once."""

import pytest
from c_library import Context, Library, build


@pytest.fixture(scope="session")
def library(tmp_path_factory) -> Library:
    folder = build(tmp_path_factory.mktemp("gsgi"), "-DBUILD_SHARED_LIBS=ON", "-DCMAKE_BUILD_TYPE=Release")
    return Library(folder / "libgsgi.so")


@pytest.fixture
def context(library, gl):
    made = Context(library, gl)
    yield made
    made.destroy()
