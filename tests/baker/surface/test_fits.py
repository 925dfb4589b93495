"""Fits with the surface operator: all of a bake but its views."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from repository import SCENES
from small_tasks import sample_little

from gsgi.baker.bake import bake
from gsgi.baker.cache.store import Cache
from gsgi.baker.over.rasterise import set_thread_count
from gsgi.baker.plan import Plan, make_plan
from gsgi.baker.progress import Progress, Silent
from gsgi.baker.settings import Settings
from gsgi.baker.surface import budget, samples, spots, unlit
from gsgi.baker.surface.fits import SurfaceFits
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import SurfaceBlend
from gsgi.runtime.gltf.reader import read_gltf

CORNELL = SCENES / "cornell.glb"
QUIET = Progress()


@pytest.fixture(scope="module")
def plan() -> Plan:
    settings = Settings(budget=64, views=2, size=24, samples=64, bounces=2, iterations=20)
    return make_plan(read_gltf(CORNELL), settings, QUIET, Cache())


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    sample_little(monkeypatch.setattr)


def test_the_same_bytes_each_time_whatever_the_number_of_threads(plan):
    files = []
    try:
        for count in (1, 2, 2):
            set_thread_count(count)
            files.append(bake(plan, QUIET).data)
    finally:
        set_thread_count(0)
    assert files[0] == files[1] == files[2]
    assert bake(replace(plan, settings=replace(plan.settings, seed=1)), QUIET).data != files[0]


def test_light_that_varies_gets_more_gaussians_of_the_same_samples(plan):
    said, display = [], Silent()
    display.say = said.append
    progress = Progress(display)
    varied = replace(plan, by_light=True)
    vars(varied)["sampler"] = copy(plan.sampler)
    vars(varied.sampler)["contrast"] = 1.0
    files = [codec.decode(bake(each, progress).data) for each in (plan, varied)]
    assert varied.most_gaussians == plan.points // budget.SAMPLES_LEAST == 128
    assert len(files[0].gaussians) <= 48
    assert 100 <= len(files[1].gaussians) <= 128 - 16
    np.testing.assert_array_equal(files[0].coarse.position, files[1].coarse.position)
    assert "light varies more than shapes: at most 128 Gaussians, where shapes alone call for 64" in said


def test_black_samples_of_dark_cameras_go_to_the_fit_and_not_to_that_of_an_edit(plan, monkeypatch):
    """The wall between is left out: all that cameras see is chosen."""
    dark = replace(plan, dark=frozenset(list(plan.placement.fitted)[1:]))
    monkeypatch.setattr(unlit, "beside_light", lambda position, normal, samples, triangles: samples[: len(position)])
    fits = SurfaceFits(dark, QUIET)
    surface, _ = fits.samples(64)
    assert len(surface) < len(fits._with_unlit(surface)) <= 2 * len(surface)
    assert SurfaceFits(plan, QUIET)._with_unlit(surface) is surface  # no camera is dark
    fits.plan = replace(dark, start=codec.decode(bake(plan, QUIET).data))
    assert fits._with_unlit(surface) is surface


def test_spots_get_gaussians_and_samples(plan, monkeypatch, tmp_path):
    before, found = codec.decode(bake(plan, QUIET).data), []

    def three(points, glance, surface, gaussians, coarse, blend, most):
        some = points.at([500, 900, 1300])
        assert (glance(some).finite_a == samples.GLANCE * samples.PASS_SAMPLES).all()
        found.append(spots.Spots(**vars(some), radius=np.full(3, 0.05, np.float32)))
        return found[-1]

    monkeypatch.setattr(spots, "false_spots", three)
    there = make_plan(plan.scene, plan.settings, QUIET, Cache(tmp_path))
    after, again = (codec.decode(bake(there, QUIET).data) for _ in range(2))
    assert len(found) == 1
    assert there.sampler.entries["spots-0"][1:]
    np.testing.assert_array_equal(after.gaussians.position, again.gaussians.position)
    assert len(after.gaussians) == len(before.gaussians) == 48  # the budget
    away = np.linalg.norm(after.gaussians.position[:, None] - found[0].position, axis=2).min(axis=0)
    assert (away < 1e-2).all()


def test_a_file_holds_both_levels_of_the_budget(plan):
    baked = bake(plan, QUIET)
    read = codec.decode(baked.data)
    assert isinstance(read.blend, SurfaceBlend)
    assert 44 <= len(read.gaussians) <= 48  # those that hardly a sample sees at the end go
    assert len(read.coarse) == 16
    assert (read.gaussians.sh_degree, read.coarse.sh_degree) == (
        budget.FINE_DEGREE,
        budget.COARSE_DEGREE,
    )
    assert 0.5 * plan.file_bytes < len(baked.data) <= plan.file_bytes
    assert read.tone_scale == np.float32(plan.pilot.mean)
