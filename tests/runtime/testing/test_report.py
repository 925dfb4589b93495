"""The report of screenshots: one page that shows all comparisons, and what failed side by side."""

import re
import shutil
import subprocess
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import OpenImageIO  # noqa: F401 (see test_plugin)
import pytest

from gsgi.runtime.image import write_image
from gsgi.runtime.testing.comparison import _flip
from gsgi.runtime.testing.record import Record
from gsgi.runtime.testing.report import html

KINDS = "actual", "expected", "difference"
FIGURES = {"FLIP mean": (0.0312345, 0.02), "pixels off": (0.0005, 0.001)}
SPELLED = ["0.03123", "0.02", "0.05 %", "0.1 %"]


class Page(HTMLParser):
    """Tags with their attributes in order, the cells of each table row, and the text."""

    def __init__(self, text: str):
        super().__init__()
        self.source, self.tags, self.rows, self.text = text, [], [], ""
        self.in_table = False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.in_table |= tag == "table"
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        self.in_table &= tag != "table"

    def handle_data(self, data):
        self.text += data
        if self.in_table and self.rows and self.rows[-1]:
            self.rows[-1][-1] += data.strip()

    def all(self, name: str, attribute: str) -> list[str]:
        return [attributes[attribute] for tag, attributes in self.tags if tag == name and attribute in attributes]


@pytest.fixture
def page(tmp_path) -> Page:
    """A run in which three of five screenshots failed, each in its own way."""
    for i, kind in enumerate(KINDS):
        write_image(tmp_path / f"{kind}.png", np.full((2, 3, 3), 80 * i, np.uint8))
    pictures = {kind: f"{kind}.png" for kind in KINDS} | {"actual, linear": "actual.exr"}
    sized = {kind: pictures[kind] for kind in ("actual", "expected")}
    records = [
        Record("test.py::test_a", "a", "equal", "a.png", "a.png", {}, "", {}),
        Record("test.py::test_b[<i>]", "b", "failed", "b.png", "b@nv.png", FIGURES, "<b> differs", pictures),
        Record("test.py::test_c", "c", "failed", "c.png", "c.png", {}, "c is 3 x 2 px", sized),
        Record("test.py::test_d", "d", "close", "d.png", "d.png", FIGURES | {"FLIP mean": (0.01, 0.02)}, "", {}),
        Record("test.py::test_e", "e", "failed", "e.png", "", {}, "no golden image", {"actual": "actual.png"}),
    ]
    return Page(html(records, tmp_path))


def test_the_tables_list_failures_then_the_rest(page):
    head = ["Test", "Screenshot", "Verdict", "FLIP mean", "allowed", "pixels off", "allowed", "Golden image"]
    assert page.rows == [
        head,
        ["test.py::test_b[<i>]", "b", "differs", *SPELLED, "b@nv.png"],
        ["test.py::test_c", "c", "other size", "", "", "", "", "c.png"],
        ["test.py::test_e", "e", "no golden image", "", "", "", "", ""],
        head,
        ["test.py::test_a", "a", "equal", "", "", "", "", "a.png"],
        ["test.py::test_d", "d", "close", "0.01", *SPELLED[1:], "d.png"],
    ]
    assert "3 of 5 screenshots failed" in page.text
    assert "2 passed" in page.text


def test_only_a_figure_above_its_limit_is_marked(page):
    assert [name for name in page.all("td", "class") if "above" in name] == ["figure above"]


def test_a_failures_name_leads_to_its_pictures(page):
    assert page.all("a", "href") == [f"#{name}" for name in page.all("section", "id")]
    assert len(page.all("section", "id")) == 3


def test_pictures_stand_in_one_row(page):
    assert page.all("figure", "class") == ["expected", "actual", "difference", "expected", "actual", "actual"]
    assert page.all("img", "alt") == page.all("figure", "class")
    assert page.all("div", "class").count("row") == 3
    assert page.all("div", "class").count("legend") == 1


def test_nothing_is_loaded(page):
    sources = page.all("img", "src")
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in sources)
    assert len(set(sources)) == 3
    assert not {"link", "iframe", "object", "base"} & {tag for tag, _ in page.tags}
    assert not page.all("script", "src")
    rest = re.sub(r"data:image/png;base64,[\w+/=]+", "", page.source)
    assert not re.search(r"//\w|url\(|@import|fetch\(|import ", rest)


def test_light_and_dark_define_the_same_colors(page):
    light, dark = (set(re.findall(r"(--\w+): #", block)) for block in re.findall(r":root \{(.*?)\}", page.source))
    assert light == dark
    assert light >= set(re.findall(r"var\((--\w+)\)", page.source)) - {"--split", "--quarters"}
    assert "color-scheme: light dark" in page.source


def test_the_legend_has_the_colors_of_the_difference(page):
    stops = re.search(r"linear-gradient\(to right, (.*?)\)", page.source)[1].split(", ")
    rgb = np.array([[int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in stops])
    golden, actual = np.random.default_rng(0).random((2, 64, 64, 3), np.float32)
    golden[:32], actual[:32] = np.linspace(0, 1, 64)[:, None], 0
    errors = _flip(golden, actual, magma=False)[..., 0].ravel()
    heat = _flip(golden, actual, magma=True).reshape(-1, 3) * 255
    places = np.linspace(0, 1, len(rgb))
    legend = np.stack([np.interp(errors, places, channel) for channel in rgb.T], axis=1)
    assert errors.min() < 0.1
    assert errors.max() > 0.7
    assert np.abs(legend - heat).max() < 12  # of 255: straight lines between the stops
    marks = re.findall(r'--quarters: (\d)">([\d.]+)<', page.source)
    assert [float(text) for _, text in marks] == [int(quarters) / 4 for quarters, _ in marks]
    assert len(marks) == 5
    assert all(int(a[0]) < int(b[0]) for a, b in pairwise(marks))


def test_the_script_is_valid(page, tmp_path):
    """Its effect was looked at in a browser."""
    if not shutil.which("node"):
        pytest.skip("needs node")
    (tmp_path / "script.js").write_text(re.search(r"<script>(.*)</script>", page.source, re.DOTALL)[1])
    run = subprocess.run(["node", "--check", tmp_path / "script.js"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_a_run_without_other_screenshots(tmp_path):
    write_image(tmp_path / "actual.png", np.zeros((2, 3, 3), np.uint8))
    record = Record("test.py::test_$title", "a", "failed", "a.png", "", {}, "$tables", {"actual": "actual.png"})
    page = Page(html([record], tmp_path))
    assert "1 of 1 screenshot failed" in page.text
    assert len(page.rows) == 2
    assert "details" not in dict(page.tags)
    assert "$tables" in page.text
