"""The pytest plugin: options and fixtures. It is loaded in every run, so fixtures do the heavy imports."""

import os
from functools import partial
from pathlib import Path

import pytest

from .collector import Collector
from .record import UPDATE


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("gsgi", "screenshots (gsgi)")
    group.addoption(
        "--gsgi-update", action="store_const", const=UPDATE[0], dest="gsgi_update",
        help="screenshots that fail become golden images: the one compared with, or one for all drivers",
    )  # fmt: skip
    group.addoption(
        "--gsgi-update-for", choices=UPDATE[1:], dest="gsgi_update",
        help="the same, but as golden images for this driver and version, or for its family",
    )  # fmt: skip
    group.addoption(
        "--gsgi-report", metavar="DIR", default="gsgi-report",
        help="where pictures of failures and report.html go (default: gsgi-report in the root folder)",
    )  # fmt: skip
    group.addoption(
        "--gsgi-backend", choices=("auto", "egl", "osmesa", "system"),
        help="OpenGL without a display; without this option, tests that need it are skipped where there is none",
    )  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("gsgi_update") and os.environ.get("CI", "").lower() not in ("", "0", "false"):
        raise pytest.UsageError("golden images are not written where CI is set: somebody has to look at them first")
    if not hasattr(config, "workerinput"):  # pytest-xdist: workers send their records to the reporting process
        config.pluginmanager.register(Collector(config, _output(config)), "gsgi-collector")


def _output(config: pytest.Config) -> Path:
    return config.rootpath / config.getoption("gsgi_report")


@pytest.fixture(scope="session")
def gsgi_context(request: pytest.FixtureRequest):
    """A headless OpenGL context (moderngl.Context), released at the end of the run.

    Without OpenGL, tests are skipped, or fail if --gsgi-backend asked for it. A project that has its own context
    overrides this fixture, because a process should hold only one.
    """
    from gsgi.runtime.errors import UnsupportedError
    from gsgi.runtime.gl.context import create_context

    backend = request.config.getoption("gsgi_backend")
    try:
        context = create_context(backend or "auto")
    except UnsupportedError as error:
        if backend:
            raise
        pytest.skip(str(error))
    yield context
    context.release()


@pytest.fixture(scope="session")
def gsgi_driver(gsgi_context):
    """The driver as golden images name it (gsgi.runtime.testing.driver.Driver).

    A project that does not draw with `gsgi_context` overrides this fixture.
    """
    from .driver import driver_of

    return driver_of(gsgi_context.info)


@pytest.fixture
def gsgi_render(gsgi_context):
    """`gsgi_render(scene, camera=None, size=(160, 120), *, bake=None, layer=None, exposure=1.0)` draws a frame.

    The frame is (H, W, 3) uint8 as displayed, or the linear values of a layer; see gsgi.runtime.testing.frame.draw.
    """
    from .frame import draw

    return partial(draw, gsgi_context)


@pytest.fixture
def assert_screenshot(request: pytest.FixtureRequest, gsgi_driver):
    """`assert_screenshot(image, name, *, max_flip=0.02, max_difference=2/255, max_ratio=0.001)`.

    Compares an image with screenshots/TEST_FILE/name.png (for floats: .exr) beside the test file, or with
    name@DRIVER.png if that exists; see gsgi.runtime.testing.assertion.ScreenshotAssertion.
    """
    from .assertion import ScreenshotAssertion

    config = request.config
    return ScreenshotAssertion(
        test=request.node.nodeid,
        file=request.path,
        driver=gsgi_driver,
        output=_output(config),
        root=config.rootpath,
        update=config.getoption("gsgi_update"),
        properties=request.node.user_properties,
    )
