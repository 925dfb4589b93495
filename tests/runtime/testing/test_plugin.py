"""The pytest plugin for screenshots, run by pytest on small projects: what passes, what fails, what is left behind."""

import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

# Loaded before `pytester` notes which modules there are: it forgets later ones, and this one loads once per process.
import OpenImageIO  # noqa: F401
import pytest
from repository import SAMPLES

from gsgi.runtime.image import read_image, write_image

PLUGIN = "gsgi.runtime.testing.plugin"

# No test here needs OpenGL, so the driver is told instead of asked.
CONFTEST = """
import pytest
from gsgi.runtime.testing.driver import Driver
@pytest.fixture(scope="session")
def gsgi_driver(): return Driver("llvmpipe", "llvmpipe-22.3")
"""
TEST = """
import numpy as np
def test_a(assert_screenshot):
    image = np.load("image.npy")
    assert_screenshot(image, "a")
"""
PICTURE = np.random.default_rng(0).integers(0, 200, (48, 64, 3), np.uint8)
RADIANCE = np.random.default_rng(1).exponential(2, (12, 16, 3)).astype(np.float32)
GOLDENS = Path("screenshots/test_project")


class Project:
    """A folder with one test file, which compares `image.npy` with the golden image "a"."""

    def __init__(self, pytester: pytest.Pytester):
        self.pytester, self.path = pytester, pytester.path
        self.goldens, self.output = self.path / GOLDENS, self.path / "gsgi-report"
        pytester.makeconftest(CONFTEST)
        self.write(TEST)
        self.draw(PICTURE)

    def write(self, source: str) -> None:
        self.pytester.makepyfile(test_project=source)

    def draw(self, image: np.ndarray) -> None:
        np.save(self.path / "image.npy", image)

    def golden(self, name: str, image: np.ndarray) -> Path:
        self.goldens.mkdir(parents=True, exist_ok=True)
        write_image(self.goldens / name, image)
        return self.goldens / name

    def start(self, *options: str) -> pytest.RunResult:
        """Run pytest in a process of its own (a run inside this one would load compiled modules a second time), without
        other plugins that are installed here: hypothesis takes most of a second to load."""
        return self.pytester.runpytest_subprocess("-p", PLUGIN, "-p", "no:cacheprovider", *options)

    def run(self, *options: str, passed: int = 0, failed: int = 0) -> str:
        """What a run that passes and fails this many tests prints."""
        result = self.start(*options)
        result.assert_outcomes(passed=passed, failed=failed)
        return result.stdout.str() + result.stderr.str()

    def left(self) -> list[str]:
        return sorted(re.sub("[0-9a-f]{8}", "HASH", path.name) for path in self.output.glob("*"))


@pytest.fixture
def project(pytester, monkeypatch) -> Project:
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    return Project(pytester)


def marked(image: np.ndarray) -> np.ndarray:
    """`image` with 8 x 8 px of another colour."""
    image = image.copy()
    image[20:28, 36:44] = 255
    return image


def nudged(image: np.ndarray, levels: int) -> np.ndarray:
    """`image` with 4 of 48 rows brighter: FLIP takes a whole image that is one level off for worse than rounding."""
    image = image.copy()
    image[:4] += np.uint8(levels)
    return image


def test_equal_pixels_pass_and_leave_nothing(project):
    project.golden("a.png", PICTURE)
    text = project.run(passed=1)
    assert "screenshots" not in text
    assert not project.output.exists()


def test_a_missing_golden_fails_and_is_not_made(project):
    text = project.run(failed=1)
    for name in ("a@llvmpipe-22.3.png", "a@llvmpipe.png", "a.png"):
        assert f"{GOLDENS.as_posix()}/{name}\n" in text
    assert "--gsgi-update" in text
    assert not project.goldens.exists()
    assert project.left() == ["a-HASH-actual.png", "report.html"]


def test_a_failure_says_what_was_compared(project):
    project.golden("a.png", PICTURE)
    project.draw(marked(PICTURE))
    text = project.run(failed=1)
    off = np.abs(marked(PICTURE).astype(int) - PICTURE).max(axis=2) / 2.55
    for part in (
        "screenshot 'a' differs from its golden image screenshots/test_project/a.png",
        f"max {off.max():.4g} %, mean {off.mean():.4g} % of the range",
        f"{100 * 64 / (48 * 64):.4g} % by more than 0.7843 % (allowed 0.1 %: too much)",
        "FLIP             mean 0.0",
        "(allowed 0.02",
        "worst tile       x 32 to 48, y 16 to 32: FLIP mean 0.",
        "driver           llvmpipe-22.3",
        "gsgi-report/report.html",
    ):
        assert part in text, part
    for kind in ("actual", "expected", "difference"):
        assert re.search(rf"{kind} +gsgi-report/a-[0-9a-f]{{8}}-{kind}\.png\n", text), kind


def test_a_failure_leaves_pictures(project):
    project.golden("a.png", PICTURE)
    project.draw(marked(PICTURE))
    project.run(failed=1)
    pictures = {path.stem.rpartition("-")[2]: read_image(path) * 255 for path in project.output.glob("*.png")}
    np.testing.assert_allclose(pictures["actual"], marked(PICTURE), atol=1e-3)
    np.testing.assert_allclose(pictures["expected"], PICTURE, atol=1e-3)
    # Magma is dark where nothing differs: FLIP's filters reach some pixels, not as far as the corner.
    assert pictures["difference"][24, 40].sum() > 5 * pictures["difference"][0, 0].sum()


class Page(HTMLParser):
    """Its tags with their attributes, and its text."""

    def __init__(self, text: str):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data


def test_the_report_is_one_file(project):
    project.golden("a.png", PICTURE)
    project.draw(marked(PICTURE))
    project.write(TEST + "def test_b(assert_screenshot): assert_screenshot(np.load('image.npy'), 'b+<i>'[:2])\n")
    project.run(failed=2)
    page = Page((project.output / "report.html").read_text(encoding="utf-8"))
    sources = [attributes["src"] for tag, attributes in page.tags if tag == "img"]
    assert len(sources) == 4
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in sources)
    for part in ("2 of 2 screenshots failed", "test_project.py::test_a", "worst tile", "'b+' has no golden image"):
        assert part in page.text


def test_the_report_escapes_what_tests_are_called(project):
    project.write("""
import numpy as np, pytest
@pytest.mark.parametrize("x", ["<script>alert(1)</script>"])
def test_a(assert_screenshot, x): assert_screenshot(np.zeros((8, 8)), "a")
""")
    project.run(failed=1)
    page = Page((project.output / "report.html").read_text(encoding="utf-8"))
    assert [tag for tag, _ in page.tags].count("script") == 1  # the report's own
    assert "<script>alert(1)" in page.text


def test_a_report_goes_with_what_it_reported(project):
    project.draw(marked(PICTURE))
    project.run(failed=1)
    (project.output / "mine.png").touch()
    project.golden("a.png", marked(PICTURE))
    project.run(passed=1)
    assert project.left() == ["mine.png"]


def test_the_most_specific_golden_counts(project):
    used = project.golden("a.png", PICTURE)
    for name in ("a@llvmpipe.png", "a@llvmpipe-22.3.png"):
        project.run(passed=1)
        used = project.golden(name, marked(PICTURE))
        assert f"its golden image {used.relative_to(project.path).as_posix()}\n" in project.run(failed=1)
        write_image(used, PICTURE)
    project.golden("a@softpipe.png", marked(PICTURE))
    project.run(passed=1)


def test_the_tolerance_is_the_tests_to_set(project):
    project.golden("a.png", PICTURE)
    project.draw(nudged(PICTURE, 2))
    project.run(passed=1)
    project.draw(nudged(PICTURE, 3))
    project.run(failed=1)
    project.write(TEST.replace('"a")', '"a", max_difference=3 / 255)'))
    project.run(passed=1)
    project.draw(marked(PICTURE))
    project.write(TEST.replace('"a")', '"a", max_ratio=0.05, max_flip=0.05)'))
    project.run(passed=1)
    project.write(TEST.replace('"a")', '"a", max_ratio=0.05, max_flip=0.0001)'))
    assert "(allowed 0.0001: too much)" in project.run(failed=1)


def test_another_size_fails_as_such(project):
    project.golden("a.png", PICTURE[:-1])
    text = project.run(failed=1)
    assert "is 64 x 48 px, its golden image screenshots/test_project/a.png is 64 x 47" in text
    assert project.left() == ["a-HASH-actual.png", "a-HASH-expected.png", "report.html"]


def test_an_update_writes_what_fails_and_says_so(project):
    text = project.run("--gsgi-update", passed=1)
    assert "golden image written: screenshots/test_project/a.png" in text
    project.run(passed=1)
    project.draw(marked(PICTURE))
    project.run("--gsgi-update", passed=1)
    np.testing.assert_allclose(read_image(project.goldens / "a.png") * 255, marked(PICTURE), atol=1e-3)
    assert not project.output.exists()


def test_an_update_leaves_what_is_close_enough(project):
    path = project.golden("a.png", PICTURE)
    project.draw(nudged(PICTURE, 2))
    before = path.read_bytes()
    assert "image written" not in project.run("--gsgi-update", passed=1)
    assert path.read_bytes() == before


def test_an_update_writes_the_golden_that_was_compared(project):
    plain, own = project.golden("a.png", PICTURE), project.golden("a@llvmpipe.png", PICTURE)
    before = plain.read_bytes()
    project.draw(marked(PICTURE))
    project.run("--gsgi-update", passed=1)
    assert plain.read_bytes() == before
    np.testing.assert_allclose(read_image(own) * 255, marked(PICTURE), atol=1e-3)


@pytest.mark.parametrize(("whose", "name"), [("driver", "a@llvmpipe-22.3.png"), ("family", "a@llvmpipe.png")])
def test_an_update_for_a_driver_leaves_the_others_alone(project, whose, name):
    before = project.golden("a.png", PICTURE).read_bytes()
    project.draw(marked(PICTURE))
    project.run("--gsgi-update-for", whose, passed=1)
    assert (project.goldens / "a.png").read_bytes() == before
    assert sorted(path.name for path in project.goldens.iterdir()) == sorted(["a.png", name])
    project.run(passed=1)


@pytest.mark.parametrize("option", ["--gsgi-update", "--gsgi-update-for=driver"])
def test_no_golden_is_written_in_ci(project, monkeypatch, option):
    monkeypatch.setenv("CI", "true")
    result = project.start(option)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines("*golden images are not written where CI is set*")
    project.run(failed=1)
    assert not project.goldens.exists()
    monkeypatch.setenv("CI", "false")
    project.run(option, passed=1)


@pytest.mark.parametrize("image", [RADIANCE, RADIANCE[..., 0]])
def test_floats_have_an_exr_to_the_bit(project, image):
    project.draw(image)
    project.run("--gsgi-update", passed=1)
    golden = read_image(project.goldens / "a.exr")
    np.testing.assert_array_equal(golden, np.broadcast_to(image.reshape(12, 16, -1), (12, 16, 3)))
    project.write(TEST.replace('"a")', '"a", max_flip=0, max_difference=0, max_ratio=0)'))
    project.run(passed=1)
    changed = image * np.float32(1.1)
    project.draw(changed)
    text = project.run(failed=1)
    assert "100 % by more than 0 %" in text
    assert "of the golden value" in text
    kinds = ["actual.exr", "actual.png", "difference.png", "expected.png"]
    assert project.left() == [*(f"a-HASH-{kind}" for kind in kinds), "report.html"]
    (linear,) = project.output.glob("*.exr")
    np.testing.assert_array_equal(read_image(linear)[..., 0], changed.reshape(12, 16, -1)[..., 0])


def test_where_pictures_cannot_be_written_the_difference_is_told(project):
    project.golden("a.png", PICTURE)
    project.draw(marked(PICTURE))
    (project.path / "gsgi-report").write_text("a file where a folder should be")
    text = project.run(failed=1)
    assert "screenshot 'a' differs from its golden image" in text
    assert re.search(r"  no pictures: .*exists.*; --gsgi-report DIR puts them elsewhere\n", text)
    assert re.search(r"1 failed, and no report: .*gsgi-report", text)
    text = project.run("--gsgi-report", "elsewhere", failed=1)
    assert "no pictures" not in text


def test_a_golden_that_cannot_be_written_is_named(project):
    project.goldens.parent.mkdir()
    project.goldens.write_text("a file where a folder should be")
    text = project.run("--gsgi-update", failed=1)
    assert f"{GOLDENS.as_posix()}/a.png: cannot write: " in text


@pytest.mark.parametrize("bytes_", [b"", b"no picture", None])
def test_a_golden_that_cannot_be_read_fails_until_an_update(project, bytes_):
    golden = project.golden("a.png", PICTURE)
    golden.write_bytes(golden.read_bytes()[:99] if bytes_ is None else bytes_)
    text = project.run(failed=1)
    assert "screenshot 'a' has a golden image that cannot be read: " in text
    assert "again with --gsgi-update" in text
    assert project.left() == ["a-HASH-actual.png", "report.html"]
    project.run("--gsgi-update", passed=1)
    project.run(passed=1)


def test_two_tests_that_write_one_golden_are_named(project):
    project.write(TEST + "def test_b(assert_screenshot): assert_screenshot(255 - np.load('image.npy'), 'a')\n")
    result = project.start("--gsgi-update")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(f"ERROR: {GOLDENS}/a.png was written by each of *::test_a, *::test_b: name them apart")
    project.write(TEST + "def test_b(assert_screenshot): assert_screenshot(np.load('image.npy'), 'a')\n")
    assert project.start("--gsgi-update").ret == pytest.ExitCode.OK  # one picture, which both should show


def test_unused_goldens_are_listed_after_a_full_run(project):
    for name in ("a.png", "a@nvidia.png", "old.png", "old.exr"):
        project.golden(name, PICTURE if name.endswith("png") else RADIANCE)
    text = project.run(passed=1)
    for name in ("old.png", "old.exr"):
        assert f"golden image that no test asked for: {(GOLDENS / name).as_posix()}" in text
    assert "a@nvidia" not in text


@pytest.mark.parametrize("options", [("-k", "test_a"), ("-m", "not slow"), ("test_project.py::test_a",)])
def test_a_run_of_some_tests_lists_none(project, options):
    project.golden("a.png", PICTURE)
    project.golden("old.png", PICTURE)
    assert "no test asked" not in project.run(*options, passed=1)


def test_a_file_with_a_test_that_did_not_end_lists_none(project):
    project.golden("a.png", PICTURE)
    project.golden("b.png", PICTURE)
    rest = "def test_b(assert_screenshot): {}; assert_screenshot(np.load('image.npy'), 'b')\n"
    project.write(TEST + rest.format("assert False"))
    assert "no test asked" not in project.run(passed=1, failed=1)
    project.write(TEST + "import pytest\n" + rest.format("pytest.skip()"))
    result = project.start()
    assert "no test asked" not in result.stdout.str()


def test_each_comparison_is_a_property_in_junit_files(project):
    project.golden("a@llvmpipe.png", PICTURE)
    project.draw(nudged(PICTURE, 2))
    project.run("--junitxml=junit.xml", passed=1)
    (entry,) = ElementTree.parse(project.path / "junit.xml").iter("property")
    assert entry.get("name") == "gsgi_screenshot"
    record = json.loads(entry.get("value"))
    assert (record["outcome"], record["used"]) == ("close", "screenshots/test_project/a@llvmpipe.png")
    assert record["figures"]["pixels off"] == [0, 0.001]
    flip, limit = record["figures"]["FLIP mean"]
    assert 0 < flip < limit == 0.02


def test_without_opengl_tests_are_skipped_unless_it_was_asked_for(project):
    project.pytester.makeconftest("")
    project.write("""
import pytest
from gsgi.runtime.gl import context
from gsgi.runtime.errors import UnsupportedError
@pytest.fixture(scope="session", autouse=True)
def no_driver():
    def refuse(backend): raise UnsupportedError("no OpenGL here")
    context.create_context = refuse
def test_a(assert_screenshot): pass
def test_b(gsgi_render): pass
""")
    result = project.start("-rs")
    result.assert_outcomes(skipped=2)
    assert "no OpenGL here" in result.stdout.str()
    result = project.start("--gsgi-backend=egl")
    result.assert_outcomes(errors=2)


def test_without_flip_it_is_said_what_to_install(project):
    project.pytester.makeconftest(f"import sys\nsys.modules['flip_evaluator'] = None\n{CONFTEST}")
    project.golden("a.png", PICTURE)
    project.run(passed=1)
    project.draw(PICTURE + 1)
    assert "install gsgi with its extra, '.[test]'" in project.run(failed=1)


def test_who_compares_nothing_sees_nothing(project, monkeypatch):
    monkeypatch.delenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD")
    project.golden("old.png", PICTURE)
    project.write("import sys\ndef test_a(): assert not {'moderngl', 'OpenImageIO'} & set(sys.modules)\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:dash"]  # a process of its own: this one has loaded all that
    run = subprocess.run(command, cwd=project.path, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    assert "screenshot" not in run.stdout
    assert not project.output.exists()


def test_the_sample_passes_as_a_copy(gl, tmp_path):
    """In a process of its own, which makes its own context."""
    for name in ("05_screenshot_test.py", "scenes/cornell.glb"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(SAMPLES / name, tmp_path / name)
    goldens = Path("screenshots", "05_screenshot_test")
    shutil.copytree(SAMPLES / goldens, tmp_path / goldens)
    command = [sys.executable, "-m", "pytest", "-p", "no:dash"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    assert "3 passed" in run.stdout
    assert "no test asked" not in run.stdout
    shutil.copy(tmp_path / goldens / "cornell-front.png", tmp_path / goldens / "cornell-corner.png")
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert "1 failed, 2 passed" in run.stdout
