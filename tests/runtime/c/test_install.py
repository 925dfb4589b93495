"""`cmake --install`, static and shared, and a program that finds the library by CMake's package or by pkg-config."""

import os
import re
import shlex
import shutil
import subprocess

import pytest
from c_library import SOURCE, build
from repository import ROOT

PROGRAM = """#include <gsgi.h>
#include <string.h>
int main(void) { return gsgi_version() != GSGI_VERSION || strcmp(gsgi_result_string(GSGI_OK), "GSGI_OK") != 0; }
"""
PROJECT = """cmake_minimum_required(VERSION 3.21)
project(program LANGUAGES C)
find_package(gsgi 0.1 REQUIRED)
add_executable(program program.c)
target_link_libraries(program PRIVATE gsgi::gsgi)
"""


@pytest.mark.parametrize("shared", [False, True], ids=["static", "shared"])
def test_a_program_finds_the_installed_library(shared_build, tmp_path, shared):
    folder = shared_build if shared else build(tmp_path / "build", "-DCMAKE_INSTALL_LIBDIR=lib")
    prefix = tmp_path / "some where" / "else"  # the package may be moved
    subprocess.run(["cmake", "--install", folder, "--prefix", prefix], check=True, capture_output=True)
    files = {str(path.relative_to(prefix)) for path in prefix.rglob("*") if path.is_file()}
    assert {"include/gsgi.h", "lib/pkgconfig/gsgi.pc", "lib/cmake/gsgi/gsgi-config.cmake"} <= files
    assert ("lib/libgsgi.a" in files) != shared
    program = tmp_path / "program"
    program.mkdir()
    (program / "program.c").write_text(PROGRAM)
    (program / "CMakeLists.txt").write_text(PROJECT)
    built = build(program / "build", f"-DCMAKE_PREFIX_PATH={prefix}", source=program)
    subprocess.run([built / "program"], check=True)

    if shutil.which("pkg-config") is None:
        pytest.skip("pkg-config is not installed")
    environment = os.environ | {"PKG_CONFIG_PATH": str(prefix / "lib" / "pkgconfig")}
    find = ["pkg-config", "--cflags", "--libs", "gsgi"]
    flags = shlex.split(subprocess.run(find, env=environment, check=True, capture_output=True, text=True).stdout)
    subprocess.run(["cc", "program.c", *flags, "-o", "by_pkg_config"], cwd=program, check=True)
    libraries = os.environ | {"LD_LIBRARY_PATH": str(prefix / "lib")}
    subprocess.run([program / "by_pkg_config"], check=True, env=libraries)


def test_the_header_is_cplusplus_too(tmp_path):
    if shutil.which("c++") is None:
        pytest.skip("c++ is not installed")
    (tmp_path / "program.cpp").write_text(PROGRAM)
    flags = ["-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{SOURCE}", "-fsyntax-only"]
    subprocess.run(["c++", *flags, "program.cpp"], cwd=tmp_path, check=True)


def test_a_shared_library_shows_its_functions_alone(library):
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed")
    listing = subprocess.run([nm, "-D", "--defined-only", library.functions._name], capture_output=True, text=True)
    names = {line.split()[-1] for line in listing.stdout.splitlines()}
    assert len(names) == 40
    assert all(name.startswith("gsgi_") and not name.startswith("gsgi__") for name in names)


def test_the_version_is_that_of_the_python_package():
    stated = re.search(r'^version = "([\d.]+)"', (ROOT / "pyproject.toml").read_text(), re.M)[1]
    header = (SOURCE / "gsgi.h").read_text()
    assert ".".join(re.findall(r"^#define GSGI_VERSION_\w+ (\d+)$", header, re.M)) == stated
    assert f"project(gsgi VERSION {stated} " in (SOURCE / "CMakeLists.txt").read_text()
