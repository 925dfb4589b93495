"""The add-on for three.js, in a browser."""

from dataclasses import replace

import numpy as np
import pytest
from browser import visit
from gsgi_files import constant, example, surface_example
from javascript import JS
from repository import TESTS
from surface_cases import with_relief
from surface_frames import nothing, one

import gsgi
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, LightGroup, SurfaceBlend

PAGES = TESTS / "runtime" / "js" / "pages"
TEXEL = 60, 170, 210  # of the normal map in pages/materials.js
BUMPY = with_relief(surface_example())
EVEN, OTHER = np.array([0.5, 0.25, 0.125]), np.array([0.125, 0.5, 0.25])


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What pages/materials.js saw."""
    folder = tmp_path_factory.mktemp("files")
    spot = Bake(one(rotation=(0, 0, 0, 1), scale=(0.5, 0.5, 0.5)), SurfaceBlend(), coarse=nothing())
    part = [replace(constant(light), groups=()) for light in (OTHER, EVEN)]
    groups = [
        LightGroup(name, patterns, each.gaussians.sh, each.gaussians.slope, each.coarse.sh)
        for (name, patterns), each in zip((("base", ()), ("lamps", ("lamp*",))), part, strict=True)
    ]
    both = replace(constant(EVEN + OTHER), groups=tuple(groups))
    files = {"groups": both, "even": constant(EVEN), "other": constant(OTHER), "spot": spot, "over": example(3)}
    files["bumpy"] = BUMPY
    files["levels"] = replace(files["even"], coarse=files["other"].coarse)
    for name, bake in files.items():
        (folder / f"{name}.gsgi").write_bytes(codec.encode(bake))
    (folder / "damaged.gsgi").write_bytes(codec.encode(files["even"])[:-1])
    result = visit("pages/materials.html", {"pages": PAGES, "js": JS, "files": folder})
    assert "error" not in result, result["error"]
    return result


@pytest.mark.parametrize("kind", ["lambert", "phong", "toon", "physical", "flat", "list", "instanced", "skinned"])
def test_a_white_material_shows_the_light(found, kind):
    np.testing.assert_allclose(found["kinds"][kind], EVEN, rtol=2e-3)


def test_a_standard_material_keeps_what_its_specular_part_takes(found):
    share = np.array(found["kinds"]["standard"]) / EVEN
    assert np.ptp(share) < 1e-3
    assert 0.9 < share[0] < 1


def test_without_the_light_everything_is_as_before(found):
    assert not np.any(list(found["without"].values()))
    assert found["restored"]
    assert not np.any(found["none"])
    assert not np.any(found["disposed"])


def test_hooks_clones_and_shared_materials(found):
    np.testing.assert_allclose(found["hook"], [*EVEN[:2], 0.75], rtol=2e-3)
    np.testing.assert_allclose(found["copiedHook"], [*EVEN[:2], 0.75], rtol=2e-3)
    np.testing.assert_allclose(found["clone"], EVEN, rtol=2e-3)  # three.js leaves the hook behind
    np.testing.assert_allclose(found["shared"], [EVEN] * 2, rtol=2e-3)


def test_what_moves_has_the_light_of_free_space(found):
    for shown, light in zip(found["moves"], (EVEN, OTHER, EVEN), strict=True):
        np.testing.assert_allclose(shown, light, rtol=2e-3)


def test_intensity_and_visibility(found):
    np.testing.assert_allclose(found["doubled"], 2 * EVEN, rtol=2e-3)
    assert not np.any(found["invisible"])
    assert found["newPrograms"] == 0


def test_several_lights_add_up_and_leave_one_by_one(found):
    np.testing.assert_allclose(found["both"], EVEN + OTHER, rtol=2e-3)
    np.testing.assert_allclose(found["hiddenGroup"], EVEN, rtol=2e-3)
    np.testing.assert_allclose(found["second"], OTHER, rtol=2e-3)
    np.testing.assert_allclose(found["again"], EVEN, rtol=2e-3)
    np.testing.assert_allclose(found["here"], [EVEN, OTHER, EVEN], rtol=2e-3)


def test_the_bake_moves_with_the_object(found):
    assert found["spot"][0] > 0.1
    assert not np.any(found["away"])
    assert not np.any(found["turned"])  # its Gaussian faces the other way
    np.testing.assert_allclose(found["cloned"], 2 * np.array(found["spot"]), rtol=2e-3)


def test_light_groups_are_weighed(found):
    whole, dimmed, red, again, cloned = found["groups"]
    np.testing.assert_allclose(whole, EVEN + OTHER, rtol=2 ** (1 / 32) - 1)  # half a step of the file's light
    assert whole == again
    half_step = 2 ** (1 / 24) - 1  # of a group's
    np.testing.assert_allclose(dimmed, EVEN / 2 + OTHER, rtol=half_step)
    np.testing.assert_allclose(red, EVEN * [1, 0, 0], rtol=half_step)
    np.testing.assert_allclose(cloned, EVEN + OTHER / 4, rtol=half_step)
    assert found["weights"] == [{"base": 0.25, "lamps": 1}] * 2
    assert found["unknown"] == 'RangeError: no light group "lamp": there is base, lamps'


@pytest.mark.parametrize(("number", "side"), [(0, 1), (1, -1)])
def test_light_follows_normal_maps(found, number, side):
    """As it does in Python, at the point that the page reads."""
    beside = np.tan(np.radians(20)) * 2 / 4 / 2  # half a pixel of the page's 8
    at, plane = np.array([[0.1 + beside, 0.2 + beside, 0]]), np.array([[0.0, 0, 1]])
    bent = (np.array([TEXEL]) / 127.5 - 1) * [1, side, 1]
    light, flat = (gsgi.sample(codec.decode(codec.encode(BUMPY)), at, plane, mapped=n)[0] for n in (bent, plane))
    assert np.abs(light - flat).max() > 0.05
    np.testing.assert_allclose(found["bumpy"][number], light, rtol=2e-3)


def test_files_are_decoded_in_a_worker_where_there_is_one(found):
    assert [answers for answers, _ in found["fromWorker"]] == [1, 0, 0]
    for _, light in found["fromWorker"]:
        np.testing.assert_allclose(light, EVEN, rtol=2e-3)


def test_files_that_cannot_be_shown_are_errors(found):
    over, damaged, missing = found["errors"]
    assert over.startswith("RangeError: over.gsgi: this needs light of")
    assert damaged.startswith("FormatError: damaged.gsgi: byte ")
    assert "404" in missing


def test_the_console_is_silent(found):
    assert [line for line in found["console"] if "missing.gsgi" not in line] == []
