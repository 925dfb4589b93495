"""The study: its data is consistent, its page opens, and it goes on after an interruption."""

import copy
import csv
import io
import json
import re
import subprocess

import numpy as np
import pytest
from browser import find_browser

from gsgi.baker.cache.store import Cache
from gsgi.baker.tradeoff import ambient, lightmap, none, path_tracing, report, study
from gsgi.baker.tradeoff.drawing import WIDTH, png
from gsgi.baker.tradeoff.plots import HEIGHT, shapes

METHODS = lightmap.PLAIN, ambient.METHOD, path_tracing.DENOISED, none.METHOD


@pytest.fixture(scope="module")
def few_settings():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lightmap, "TEXELS_QUICK", (256, 4096))
        patch.setattr(path_tracing, "SAMPLES_QUICK", (4,))
        patch.setattr(path_tracing, "TILES", 1)
        patch.setattr(study, "ROUNDS_QUICK", 1)
        yield


@pytest.fixture(scope="module")
def made(few_settings, ground, tmp_path_factory):
    """A study, its folder, and its data."""
    folder = tmp_path_factory.mktemp("study")
    found = study.run(ground, METHODS, (96, 64))
    return found, folder, report.write(found, folder, "cornell </script>.glb", "gsgi tradeoff cornell.glb", "gsgi bake")


def test_the_data_is_what_was_measured(made):
    found, folder, data = made
    assert json.loads((folder / report.DATA).read_text()) == data == report.read(folder)
    assert [entry["method"] for entry in data["entries"]] == ["lightmap"] * 2 + [
        "ambient",
        "path-tracing-denoised",
        "none",
    ]
    for entry, measured in zip(data["entries"], found.entries, strict=True):
        assert entry["bake_seconds"] == pytest.approx(sum(entry["seconds"].values()), rel=1e-3)
        assert entry["mean"]["ssim"] == pytest.approx(np.mean([view["ssim"] for view in entry["views"]]), rel=1e-3)
        assert entry["worst_view"] == min(entry["views"], key=lambda view: view["ssim"])["name"]
        assert measured.images.shape[0] == len(data["views"]) == len(entry["views"])
    plain, dark = data["entries"][1], data["entries"][-1]
    assert plain["mean"]["ssim"] > dark["mean"]["ssim"]
    assert plain["free_error"] is None
    assert dark["free_error"] > 0.5
    assert dark["frame_ms"] > 0
    assert data["error_budget"] is None  # without our own method
    assert data["entries"][3]["more_ms"] > plain["more_ms"]  # path tracing against a look-up


def test_the_ranking_names_entries_that_reach_the_goal(made):
    _, _, data = made
    for goal, places in data["ranking"].items():
        chosen = [data["entries"][i] for i in places]
        assert all(entry["mean"]["ssim"] >= float(goal) for entry in chosen)
        reached = {entry["method"] for entry in data["entries"] if entry["mean"]["ssim"] >= float(goal)}
        assert {entry["method"] for entry in chosen} == reached
        assert [e["frame_ms"] for e in chosen] == sorted(e["frame_ms"] for e in chosen)


def test_the_table_has_a_row_for_every_entry(made):
    _, folder, data = made
    rows = list(csv.DictReader(io.StringIO((folder / "study.csv").read_text())))
    assert [float(row["ssim"]) for row in rows] == [entry["mean"]["ssim"] for entry in data["entries"]]
    assert [int(row["file_bytes"]) for row in rows] == [entry["file_bytes"] for entry in data["entries"]]


def test_the_page_needs_nothing_else(made):
    _, folder, data = made
    page = (folder / report.PAGE).read_text()
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page)
    assert "<!-- plot" not in page
    assert page.count("<svg ") == 3
    embedded = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)[1]
    assert json.loads(embedded)["study"] == data
    assert len(re.findall(r'class="dot"', page)) == 3 * len(data["entries"])


def test_plots_are_files_too(made):
    from PIL import Image

    _, folder, data = made
    for cost in ("frame-ms", "file-bytes", "bake-seconds"):
        assert (folder / f"error-{cost}.svg").read_text().startswith("<svg xmlns")
        with Image.open(folder / f"error-{cost}.png") as image:
            assert image.width == 2 * WIDTH
            assert len(image.getcolors(1 << 20)) > 20
    assert png(shapes(data, "frame_ms"), HEIGHT) == (folder / "error-frame-ms.png").read_bytes()


def test_a_browser_shows_the_page(made, tmp_path):
    browser = find_browser()
    folder = made[1]
    command = [browser, "--headless", "--no-sandbox", "--virtual-time-budget=10000", "--enable-logging=stderr"]
    url = (folder / report.PAGE).as_uri()
    shown = subprocess.run([*command, "--dump-dom", url], capture_output=True, text=True, timeout=120, check=True)
    assert "CONSOLE" not in shown.stderr
    assert 'data-ready="yes"' in shown.stdout
    assert shown.stdout.count("not reached") >= 1
    shot = tmp_path / "page.png"
    options = [f"--screenshot={shot}", "--window-size=1240,4700", "--hide-scrollbars"]
    subprocess.run([*command, *options, url], capture_output=True, timeout=120, check=True)
    from PIL import Image

    with Image.open(shot) as image:
        assert len(image.convert("RGB").getcolors(1 << 24)) > 1000  # pictures, and not only text


def fresh(ground, cache: Cache):
    """The ground as a new process makes it, with what the cache holds."""
    made = copy.copy(ground)
    made.cache, made._kept = cache, {}
    return made


def test_an_interrupted_study_goes_on(few_settings, ground, tmp_path):
    baked = []

    def counted(ground, value, progress):
        baked.append(value)
        if len(baked) == 2:
            raise KeyboardInterrupt
        return lightmap.bake_plain(ground, value, progress)

    counted.__module__ = lightmap.__name__
    method = lightmap.PLAIN._replace(bake=counted)
    cache = Cache(tmp_path, 1 << 30)
    with pytest.raises(KeyboardInterrupt):
        list(study._bake_all(fresh(ground, cache), [method]))
    done = list(study._bake_all(fresh(ground, cache), [method]))
    small, large = method.settings(ground)
    assert baked == [small, large, large]
    assert [each.value for each in done] == [small, large]
