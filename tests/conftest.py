"""The order of test files; fixtures that need a machine: OpenGL contexts."""

import os
import pathlib
import shutil
import signal
import subprocess
import sys

import pytest
from compatibility import create_compatibility_context, create_es_context

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gl.context import create_context

pytest_plugins = ["pytester"]

# Files that take a minute or more. They come first: a core that began one last would end the run alone.
LONG = (
    "baker/cli/test_resume.py",
    "baker/cli/test_commands.py",
    "baker/cli/test_update.py",
    "baker/tasks/test_tasks.py",
    "hard_cases/test_cases.py",
)


def pytest_configure():
    """Notice Ctrl-C, also where a shell that runs the tests in the background has told them to ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items):
    """Sort the files of LONG to the front."""
    tests = pathlib.Path(__file__).parent
    rank = {tests / name: n for n, name in enumerate(LONG)}
    items.sort(key=lambda item: rank.get(item.path, len(LONG)))


@pytest.fixture(scope="session")
def gl():
    """A headless EGL context, current in this process. Skips if there is none."""
    try:
        ctx = create_context("egl")
    except UnsupportedError as error:
        pytest.skip(str(error))
    yield ctx
    ctx.release()


@pytest.fixture(scope="session")
def gsgi_context(gl):
    """Make the plugin for screenshots draw in the same context."""
    return gl


@pytest.fixture(scope="session")
def backends() -> tuple[str, ...]:
    """Names of the backends that work here, from child processes: one process should hold one kind of context."""
    probe = "import sys; from gsgi.runtime.gl.context import create_context; create_context(sys.argv[1])"
    names = ("egl", "osmesa")
    return tuple(
        n for n in names if not subprocess.run([sys.executable, "-c", probe, n], capture_output=True).returncode
    )


@pytest.fixture(scope="session")
def no_display() -> dict[str, str]:
    """The environment without a display."""
    return {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}


@pytest.fixture(scope="session")
def display(no_display):
    """The environment with a display that has no screen. Skips where there is no Xvfb."""
    if not shutil.which("Xvfb"):
        pytest.skip("no Xvfb: apt-get install xvfb")
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    yield no_display | {"DISPLAY": f":{server.stdout.readline().strip()}"}
    server.terminate()
    server.wait()


@pytest.fixture
def small_disk(tmp_path):
    """A mounted disk of 64 KiB. Skips if mounting is not allowed."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder], capture_output=True, text=True)
    if mount.returncode:
        pytest.skip(f"cannot mount a small disk: {mount.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.fixture(scope="session")
def pyrender():
    """The module, for its scenes. Skips if it cannot be imported."""
    try:
        import pyrender
    except Exception as error:  # it imports pyglet and OpenGL, which can raise anything
        pytest.skip(f"pyrender: {error}")
    return pyrender


@pytest.fixture
def current_again(gl):
    """Make the shared context current again after a test whose renderers make their own."""
    yield
    gl.__enter__()


def _in_turn(gl, made):
    """Another context, released after the test, which leaves the shared one current again."""
    yield made
    made.release()
    gl.__enter__()


@pytest.fixture
def fresh_gl(gl):
    """A context whose state may stay as it is."""
    yield from _in_turn(gl, create_context())


@pytest.fixture
def es_gl(gl):
    """A fresh context of OpenGL ES."""
    try:
        made = create_es_context()
    except OSError as error:
        pytest.skip(str(error))
    yield from _in_turn(gl, made)


@pytest.fixture
def old_gl(gl):
    """A fresh context of the compatibility profile."""
    try:
        made = create_compatibility_context()
    except OSError as error:
        pytest.skip(str(error))
    yield from _in_turn(gl, made)
