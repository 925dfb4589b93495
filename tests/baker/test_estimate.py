"""The estimate and the report: they count all paths that a bake traces, and all parts of its fit."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from small_tasks import place_quickly
from traced_paths import counted

from gsgi.baker import estimate as estimating
from gsgi.baker import job
from gsgi.baker.cache.store import Cache
from gsgi.baker.estimate import Rates, estimate
from gsgi.baker.evaluation import bias, held_out, moving
from gsgi.baker.plan import Plan, make_plan
from gsgi.baker.plan_table import decisions
from gsgi.baker.progress import Progress
from gsgi.baker.settings import OPERATORS, Settings
from gsgi.baker.surface import budget, chunks, grey_fit
from gsgi.baker.surface.budget import COARSE_SHARE, FREE_PER_GAUSSIAN
from gsgi.baker.surface.colours import LEAST, MOST
from gsgi.baker.surface.fit import PARTS, SOLVED_EVERY
from gsgi.baker.surface.group_light import SOLUTIONS
from gsgi.baker.surface.turns import mean_part
from gsgi.baker.trace import gathered, guide, known_light
from gsgi.baker.trace.irradiance_cache import UNKNOWN, IrradianceCache
from gsgi.baker.trace.tracer import PASS_SAMPLES, Tracer

CHUNK = 1 << 10
# Two chunks in free space; no whole number of passes; and no pixel is done before the others.
SETTINGS = Settings(
    budget=CHUNK // FREE_PER_GAUSSIAN * COARSE_SHARE + COARSE_SHARE,
    views=3,
    size=24,
    samples=2 * PASS_SAMPLES + 1,
    error=0.0,
    bounces=1,
    iterations=4,
)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(budget, "SAMPLES_FEWEST", CHUNK + 1)
    monkeypatch.setattr(budget, "KNOWN_MOST", 2 * CHUNK)
    monkeypatch.setattr(chunks, "CHUNK", CHUNK)
    monkeypatch.setattr(held_out, "SIZE", 16)
    monkeypatch.setattr(held_out, "SAMPLES", 2 * PASS_SAMPLES)


@pytest.fixture(scope="module")
def closed() -> Plan:
    """A plan of a closed box whose walls emit: every pixel shows a surface."""
    with pytest.MonkeyPatch.context() as patch:
        place_quickly(patch.setattr)
        return make_plan(scenes.furnace(), SETTINGS, Progress(), Cache())


@pytest.fixture
def traced(monkeypatch) -> list[int]:
    """The number of paths of each call of a tracer."""
    return counted(monkeypatch)


@pytest.fixture
def guiding(monkeypatch) -> list[int]:
    """The number of paths of each call by which a guide is learned, or whether there are bright places."""
    counts, launch = [], Tracer.launched

    def counting(tracer, kernel, *inputs):
        if getattr(kernel, "func", None) is gathered._gathered:
            counts.append(len(inputs[0]) * guide.PATHS)
        return launch(tracer, kernel, *inputs)

    monkeypatch.setattr(Tracer, "launched", counting)
    return counts


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_bake_traces_the_paths_that_were_announced(closed, traced, guiding, monkeypatch, operator):
    plan = replace(closed, settings=replace(closed.settings, operator=operator))
    monkeypatch.setattr(estimating, "_seconds_per_path", lambda plan: (1.0, 1.0, False))
    *_, shown = estimating._seconds_per_view(plan)
    monkeypatch.setattr(estimating, "_seconds_per_view", lambda plan: (0.0, 0.0, 0.0, shown))
    monkeypatch.setattr(estimating, "_seconds_of_finding", lambda plan: 0.0)
    announced = estimate(plan)
    report = job.run(plan, Progress(), lambda data, count: None).as_dict()
    paths = sum(paths for stage, paths in announced.items() if stage not in {"fit", "evaluation"})
    assert sum(guiding) == plan.guide_paths
    assert sum(traced) + plan.guide_paths == paths + moving.paths(plan)
    assert report["paths"] + plan.guide_paths == announced["irradiance"] + announced.get("known light", 0)
    traced.clear()
    job.run(replace(plan), Progress(), lambda data, count: None, evaluate=False)
    assert sum(traced) == report["paths"]
    assert report["samples"] == (3 if operator == "over" else 4) * PASS_SAMPLES


def test_a_bake_whose_paths_are_connected_reports_the_fewer_that_it_traced(monkeypatch):
    monkeypatch.setattr(known_light, "PAYS", 0.0)
    place_quickly(monkeypatch.setattr)
    plan = make_plan(scenes.spot_room(), SETTINGS, Progress(), Cache())
    assert plan.samples == 4 * PASS_SAMPLES
    report = job.run(plan, Progress(), lambda data, count: None, evaluate=False).as_dict()
    assert report["samples"] == plan.connected_samples == 2 * PASS_SAMPLES
    assert report["paths"] == plan.points * 2 * PASS_SAMPLES + plan.free_paths + plan.known_paths


def test_paths_are_timed_in_light_that_is_as_dense_as_a_bakes(closed):
    seen = closed.placement.importance
    few = np.random.default_rng(0).permutation(len(seen.position))[: CHUNK // 16]
    points = seen.position[few], seen.normal[few]
    light = np.ones((len(few), 3), np.float32)
    timed = estimating._known_light(closed, *points, light)
    baked = closed.known_light(Progress()).a
    assert timed.size == pytest.approx(baked.size, rel=0.3)
    assert len(timed.low) == pytest.approx(len(baked.low), rel=0.3)
    assert IrradianceCache.halves(*points, light, light).a.size > 2 * baked.size
    met = (timed.light != UNKNOWN).all(axis=1)
    np.testing.assert_allclose(timed.light[met], 1, rtol=1e-5)


def test_the_table_says_how_many_paths_there_are(closed):
    rows = {row.what: row for row in decisions(closed)}
    assert rows["paths"].decision == f"{4 * PASS_SAMPLES} to {4 * PASS_SAMPLES}"
    assert f"about {4 * PASS_SAMPLES} per sample" in rows["paths"].why
    # With one bounce, paths end in light without any, which is traced in two chunks by a pass per half.
    assert closed.known_paths == 2 * CHUNK * 2 * PASS_SAMPLES
    assert closed.guide_paths == 2 * CHUNK * guide.PATHS
    # In free space there are two chunks, which take two layers as well.
    assert closed.free_paths == 2 * CHUNK * 4 * PASS_SAMPLES
    assert rows["free space"].decision == "0.3 M"


@pytest.mark.parametrize(("operator", "parts"), [("over", 1), ("surface", 3)])
def test_all_parts_of_a_fit_are_timed(closed, monkeypatch, operator, parts):
    """Steps, and with `surface` the solutions for the colours and the coarse level: each with its number of runs."""
    plan = replace(closed, settings=replace(closed.settings, operator=operator))
    runs = []
    monkeypatch.setattr(estimating, "_seconds_per_path", lambda plan: (0.0, 0.0, False))
    monkeypatch.setattr(estimating, "_seconds_per_view", lambda plan: (0.0, 0.0, 0.0, 1.0))
    monkeypatch.setattr(estimating, "_seconds_of_finding", lambda plan: 0.0)
    monkeypatch.setattr(estimating, "_seconds", lambda run: (run(), runs.append(run), 10.0 ** len(runs))[2])
    fit = estimate(plan)["fit"]
    assert len(runs) == parts
    steps = SETTINGS.iterations / (3 if operator == "over" else estimating.STEPS)
    # The fine level knows half of the samples for half of the steps. Its colours are solved for three times at each of
    # six cuts, and soon again every few steps. The coarse level knows a quarter, half, and all of them for a third of
    # its thirty solutions each, and is rounded in twelve turns. One sample in 4 is timed of the fine level, and one in
    # 8 of the coarse one.
    part = 0.5 / 2 + 0.5 if operator == "surface" else 1
    solved = 18 + LEAST / MOST * part * SETTINGS.iterations / SOLVED_EVERY
    changes = 4 * grey_fit.CHANGES if operator == "surface" else 1
    others = 0 if operator == "over" else changes * 100 * solved + 1000 * 8 * (17.5 + 12 * grey_fit.TURN_TIME)
    assert fit == pytest.approx(changes * 10 * steps * part + others)


def test_what_was_timed_for_one_bake_tells_of_others(closed):
    rates = Rates(closed, 1.0, 0.5, 0.0, (2.0, 0.0, 0.0), 3.0, 5.0, 7.0)
    longer = replace(closed, settings=replace(closed.settings, iterations=8))
    before, after = rates.seconds(closed), rates.seconds(longer)
    assert before.keys() == after.keys()
    steps, looks = 4 * grey_fit.CHANGES * 2.0 * mean_part(PARTS) / estimating.STEPS, len(closed.placement.held_out)
    assert before["fit"] == pytest.approx(4 * steps + looks * 4 * 5)
    assert after["fit"] == pytest.approx(8 * steps + looks * 8 * 5)
    views = looks + len(held_out.scene_cameras(closed))
    assert before["evaluation"] == pytest.approx(7 * views + moving.PATHS)
    unseen = replace(rates, shown=0.25).seconds(closed)
    prepared = 3 * views + (1.0 * bias.PATHS if held_out.gathers(closed) else 0.0)
    assert unseen["references"] - prepared == pytest.approx((before["references"] - prepared) / 4)
    finding = replace(rates, found=11.0).seconds(closed)
    for stage, works in (("known light", estimating.BEFORE_KNOWN), ("irradiance", estimating.BEFORE_SAMPLES)):
        assert finding[stage] - before[stage] == pytest.approx(works * 11 * len(closed.placement.fitted))
    assert rates.seconds(closed, evaluate=False).keys() == before.keys() - {"references", "evaluation"}
    assert rates.seconds(closed, evaluate=False)["fit"] == pytest.approx(4 * steps)


def test_light_groups_cost_their_paths_and_solutions(closed, traced):
    plan = replace(closed, scene=replace(closed.scene, groups={"walls": ("wall",)}))
    announced = Rates(closed, 1.0, 1.0, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0).seconds(plan, evaluate=False)
    report = job.run(plan, Progress(), lambda data, count: None, evaluate=False)
    assert sum(traced) + 2 * plan.guide_paths == sum(announced.values())  # one guide for each group
    assert announced["light group walls"] == announced["known light"] + announced["irradiance"] > 0
    assert "light group walls" in report.seconds
    solved = Rates(closed, 0.0, 0.0, 0.0, (9.0, 1.0, 0.0), 0.0, 0.0, 0.0).seconds(plan, evaluate=False)
    solutions = SOLUTIONS + 12 * 6 / MOST  # and twelve turns of six iterations, in which the light is rounded
    assert solved["light group walls"] == pytest.approx(grey_fit.FINE_TIMED * grey_fit.CHANGES * solutions)
    assert {row.what: row for row in decisions(plan)}["light groups"].why.startswith("walls: ")
