"""The plan: what a scene calls for, and that a bake follows it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from small_tasks import place_quickly, sample_little

from gsgi.baker import memory
from gsgi.baker import plan as planning
from gsgi.baker.bake import bake, unfit_light
from gsgi.baker.cache.store import Cache
from gsgi.baker.over.rasterise import rasterise
from gsgi.baker.plan import PIXELS, PIXELS_PER_GAUSSIAN, SIZE_MAX, SIZE_MIN, Plan, make_plan
from gsgi.baker.plan_table import decisions, summary
from gsgi.baker.progress import Progress
from gsgi.baker.settings import EFFECTS, ERROR, OPERATORS, QUALITIES, SAMPLES, Settings
from gsgi.baker.surface.budget import GUIDED_NOISE, SAMPLES_LEAST
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.surface_detail import PER_CONTRAST, gaussians_for
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import BOUNCES_MAX
from gsgi.baker.trace.visible import Surface
from gsgi.baker.views import placement
from gsgi.baker.views.importance import POINTS, ImportanceField
from gsgi.baker.views.placement import HELD_OUT
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import GsgiError, SceneError
from gsgi.runtime.file import codec
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.lighting import Lighting, light
from gsgi.runtime.scene import Environment, Light, Material, Scene

SMALL = Settings(budget=64, views=4, size=32, samples=32, iterations=2)
LAMP = Light("point", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))


def room(albedo: float = 0.5, **changes) -> Scene:
    """A closed box with a lamp in its middle."""
    scene = Scene(tuple(scenes.box()), (Material("wall", (albedo, albedo, albedo, 1.0)),), lights=(LAMP,))
    return replace(scene, **changes)


def planned(scene: Scene, settings: Settings = SMALL, **arguments) -> Plan:
    return make_plan(scene, settings, Progress(), Cache(), **arguments)


def black(camera: Camera) -> Reference:
    """A reference without light."""
    image, everywhere = np.zeros((16, 16, 3), np.float32), np.ones((16, 16), bool)
    up = np.tile(np.float32([0, 1, 0]), (16, 16, 1))
    surface = Surface(image, up, up, up, image, image, image[..., 0], everywhere, everywhere)
    return Reference(surface, image, image, image, everywhere)


def decided(plan: Plan) -> dict[str, str]:
    return {row.what: row.decision for row in decisions(plan)}


def of(plan: Plan, **changes) -> Plan:
    """The plan with other settings, looked at no further."""
    return replace(plan, settings=replace(plan.settings, **changes))


@pytest.fixture(scope="module", autouse=True)
def few_views():
    """Fewer views than a bake has: nothing here depends on their number, or on where they are."""
    with pytest.MonkeyPatch.context() as patch:
        place_quickly(patch.setattr)
        patch.setattr(placement, "FEWEST", 48)
        yield


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    sample_little(monkeypatch.setattr)


@pytest.fixture(scope="module")
def seen() -> ImportanceField:
    return ImportanceField.of(Triangles(room()).draw(POINTS, np.random.default_rng(0)))


@pytest.fixture(scope="module")
def small() -> Plan:
    return planned(room())


QUALITY_FACTORS = {"over": (1 / 4, 1, 4), "surface": (0.9 / 16, 0.9 / 4, 0.9)}


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_quality_is_so_many_gaussians_for_the_detail_of_the_scene(seen, operator):
    for quality, factor in zip(("draft", "medium", "high"), QUALITY_FACTORS[operator], strict=True):
        settings = Settings(operator, quality, views=1000, size=96)
        assert planning._budget(settings, seen) == round(factor * gaussians_for(seen))


def test_there_are_no_more_gaussians_than_the_views_can_tell_apart(seen):
    """Those that surface points read are no matter of the views."""
    for quality in QUALITIES["over"]:
        settings = Settings("over", quality, views=2, size=64)
        assert planning._budget(settings, seen) == 2 * 64**2 // PIXELS_PER_GAUSSIAN
        few, many = (Settings("surface", quality, views=views, size=64) for views in (2, 1000))
        assert planning._budget(few, seen) == planning._budget(many, seen)


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_budget_wins_over_the_quality(seen, operator):
    for quality in QUALITIES[operator]:
        for target in (None, 0.01):
            settings = replace(SMALL, operator=operator, budget=77, quality=quality, target_loss=target)
            assert planning._budget(settings, seen) == 77


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_search_may_go_as_far_as_high_quality(seen, operator):
    many = Settings(operator, views=1000, size=96)
    high = planning._budget(replace(many, quality="high"), seen)
    for quality in QUALITIES[operator]:
        assert planning._budget(replace(many, quality=quality, target_loss=0.01), seen) == high


def lit_plan(contrast: float, **settings) -> Plan:
    """A plan whose known light has so much contrast."""
    plan = planned(room(), replace(SMALL, **({"budget": None} | settings)))
    vars(plan)["sampler"] = SimpleNamespace(contrast=contrast, until=lambda error: plan.sampler)
    return plan


def test_light_calls_for_gaussians_of_its_own():
    for quality in QUALITIES["surface"]:
        even, varied, most = (lit_plan(contrast, quality=quality) for contrast in (0.0, 0.04, 1.0))
        budget = even.settings.budget
        assert even.gaussians(budget) == budget
        wanted = QUALITIES["surface"][quality].gaussians * PER_CONTRAST * 0.04
        assert varied.gaussians(budget) == pytest.approx(max(wanted, budget), abs=1)
        assert most.gaussians(budget) == most.most_gaussians == most.points // SAMPLES_LEAST > budget


@pytest.mark.parametrize("settings", [{"budget": 77}, {"target_loss": 0.01}, {"operator": "over"}])
def test_a_budget_or_a_target_that_is_asked_for_is_kept(settings):
    plan = lit_plan(1.0, **settings)
    for count in (7, plan.settings.budget):
        assert plan.gaussians(count) == count
    assert plan.most_gaussians == plan.settings.budget


def test_what_a_deadline_decides_is_kept():
    plan = lit_plan(1.0).spending(77, 0.1, 3)
    assert plan.gaussians(77) == plan.most_gaussians == 77


def test_the_table_says_how_many_gaussians_there_may_be():
    plan = lit_plan(0.0)
    told = f"{plan.settings.budget} to {plan.most_gaussians} Gaussians"
    (row,) = (row for row in decisions(plan) if row.what == "file")
    assert (row.decision, row.why) == (f"{plan.file_bytes} bytes", f"at most, with {told}, as light varies")
    assert f", {told}, " in summary(plan)


def test_a_search_is_told():
    plan = planned(room(), replace(SMALL, operator="over", budget=None, target_loss=0.01))
    assert plan.settings.budget == plan.points // PIXELS_PER_GAUSSIAN
    for operator in OPERATORS:
        (fit,) = (row for row in decisions(of(plan, operator=operator)) if row.what == "fit")
        assert fit.why.endswith("again with more Gaussians until the held-out loss is 0.01")
        (fit,) = (row for row in decisions(of(plan, operator=operator, target_loss=None)) if row.what == "fit")
        assert "again" not in fit.why


def test_each_view_is_visited_so_often():
    for name, quality in QUALITIES["over"].items():
        few, many = (planning._iterations(Settings("over", name, views=views)) for views in (1, 10_000))
        assert (few, many) == (quality.steps, 10_000 * quality.visits)
    draft, medium, high = QUALITIES["over"].values()
    assert all(a.visits < b.visits for a, b in ((draft, medium), (medium, high)))


def test_steps_over_all_samples_are_no_matter_of_the_views():
    for name, quality in QUALITIES["surface"].items():
        assert {planning._iterations(Settings(quality=name, views=views)) for views in (1, 10_000)} == {quality.steps}


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_better_quality_is_fitted_for_longer_unless_few_gaussians_have_farther_to_go(operator):
    for name in QUALITIES[operator]:
        assert planning._iterations(Settings(operator, name, views=10_000, iterations=3)) == 3
    assert planning._iterations(Settings(operator, views=1, iterations=0)) == 0
    draft, medium, high = QUALITIES[operator].values()
    assert draft < medium < high
    if operator == "surface":
        assert draft.steps == medium.steps == high.steps
    else:
        assert draft.steps < medium.steps < high.steps


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("views", [1, 4, 411])
def test_the_target_does_not_change_how_long_a_fit_is(views, operator):
    """Nor does the budget: a try of the search is the fit that its budget would get."""
    expected = planning._iterations(Settings(operator, views=views))
    assert planning._iterations(Settings(operator, views=views, target_loss=0.01)) == expected
    assert planning._iterations(Settings(operator, views=views, budget=1)) == expected


@pytest.mark.parametrize("operator", OPERATORS)
def test_paths_and_their_noise_are_as_asked_for_or_the_operators(operator):
    scene = scenes.furnace()
    given = make_plan(scene, Settings(operator, budget=64, views=3, samples=7, error=0.5), Progress(), Cache()).settings
    assert (given.samples, given.error) == (7, 0.5)
    left_open = make_plan(scene, Settings(operator, budget=64, views=3), Progress(), Cache()).settings
    assert (left_open.samples, left_open.error) == (SAMPLES[operator], ERROR[operator])


def test_noisier_light_takes_more_paths_up_to_the_most():
    plan = make_plan(scenes.furnace(), Settings(budget=64, views=3), Progress(), Cache())
    gathered = plan.pilot.gathered
    counts = []
    for noise in (0.0, 1.0, 2.0, 100.0):
        aim = 0.05 / GUIDED_NOISE * gathered.level  # guided paths have less noise than the pilot's
        pilot = replace(plan.pilot, gathered=gathered._replace(noise=noise * aim))
        counts.append(replace(plan, pilot=pilot).samples)
    # The pilot took 64 paths: at twice the noise that is aimed at, four times as many are needed.
    assert counts == [64, 64, 256, SAMPLES["surface"]]
    still = replace(plan.settings, error=0.0)
    assert replace(plan, settings=still).samples == SAMPLES["surface"]


@pytest.mark.parametrize(
    ("factor", "says"),
    [(0.0, "^no indirect light"), (1e-8, "on average, and half floats"), (1.0, ""), (1e7, "light is up to")],
)
def test_light_that_files_do_not_hold_is_warned_of(factor, says):
    """With the factor that the warning names, nothing is left to warn of."""
    plan = planned(light(room(), Lighting(light_scale=factor or 1.0)))
    pilot = plan.pilot if factor else replace(plan.pilot, mean=0.0)
    warning = unfit_light(pilot)
    assert re.search(says, warning)
    assert bool(warning) == bool(says)
    if "about" in warning:
        by = float(warning.split()[-1])
        assert not unfit_light(replace(pilot, mean=by * pilot.mean, light=by * pilot.light))


def test_brighter_walls_call_for_more_bounces():
    bounces = [planned(room(albedo)).settings.bounces for albedo in (0.05, 0.3, 0.8)]
    assert bounces == sorted(set(bounces))


def test_bounces_and_effects_are_taken_out_of_its_hands():
    scene = room(environment=Environment(np.ones((1, 1, 3), np.float32)))
    plan = planned(scene, replace(SMALL, bounces=3, ignore=("environment",)))
    assert (plan.settings.bounces, plan.lost is None) == (3, False)
    assert plan.scene.environment is None
    assert plan.effects == Effects.PUNCTUAL
    assert planned(scene, replace(SMALL, bounces=17)).lost is None
    with pytest.raises(SceneError, match="no light"):
        planned(scene, replace(SMALL, ignore=EFFECTS))


def reason(plan: Plan, what: str) -> str:
    (row,) = (row for row in decisions(plan) if row.what == what)
    return row.why


def test_the_table_says_who_chose_the_bounces(small):
    fraction, chosen = small.settings.bounce_fraction, small.settings.bounces
    assert chosen == small.pilot.bounces(fraction)
    added = f"further bounces add {small.lost:.2%} of the picture"
    assert reason(small, "bounces") == added
    assert reason(replace(of(small, bounces=17), lost=None), "bounces") == "as requested"
    fewer, lost = next(iter(small.pilot.lost.items()))
    told = reason(replace(of(small, bounces=fewer), lost=lost), "bounces")
    assert told == f"as requested; further bounces add {lost:.2%} of the picture"
    most = replace(of(small, bounces=BOUNCES_MAX), lost=0.0)
    assert reason(most, "bounces") == "as requested; the most that are traced"
    white = replace(most, pilot=replace(small.pilot, lost={BOUNCES_MAX: 0.0}))
    assert reason(white, "bounces") == (
        "the most that are traced: light goes a long way here, between bright surfaces or into gaps"
    )


def test_a_scene_beyond_single_precision_is_refused():
    (box, *rest) = scenes.box()
    huge = replace(box, position=np.float32(1e37) * box.position)
    with pytest.raises(SceneError, match=r"the scene is \d.*e\+37 m across: expected at most 1e\+09 m"):
        planned(room(meshes=(huge, *rest)))


def test_too_little_memory_is_told_beforehand(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: memory.PROCESS - 1)
    with pytest.raises(GsgiError, match=r"^a bake takes about 1\.0 GB of memory, and 1000 MB are available$"):
        planned(room())
    monkeypatch.setattr(memory, "available", lambda: memory.PROCESS)
    progress = Progress()
    make_plan(room(), SMALL, progress, Cache())
    assert progress.warnings == ["the bake takes about 1.0 GB of memory, and 1.0 GB are available"]


def test_a_scene_without_light_is_refused():
    with pytest.raises(SceneError, match=r"no light.*--sun or --env"):
        planned(room(lights=()))


def test_cameras_of_the_scene_and_of_a_path_are_fitted_and_others_held_out():
    own, further = scenes.inside_camera(), scenes.above_camera(0.8)
    plan = planned(room(cameras={"own": own}), path={"path 1": further})
    fitted = plan.placement.fitted
    assert list(fitted)[:2] == ["own", "path 1"]
    assert plan.settings.views == len(fitted) == 4
    assert len(plan.placement.held_out) == HELD_OUT
    assert not fitted.keys() & plan.placement.held_out.keys()


@pytest.mark.parametrize(("views", "size"), [(1, SIZE_MAX), (140, SIZE_MAX), (800, 80), (10_000, SIZE_MIN)])
def test_more_views_are_smaller_views(views, size):
    assert planning._size(views) == size
    assert views * size**2 <= PIXELS or size == SIZE_MIN


def test_the_texel_size_is_that_of_the_views_as_they_are_traced():
    large, small = (planned(room(), replace(SMALL, size=size)).placement.coverage for size in (64, 32))
    assert small.texel_limit == pytest.approx(2 * large.texel_limit, rel=1e-6)


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_file_records_what_was_decided(small, operator):
    plan = of(small, operator=operator)
    baked = codec.decode(bake(plan, Progress()).data)
    assert baked.blend == codec.decode(codec.encode(replace(baked, blend=plan.blend))).blend
    assert baked.bounces == plan.settings.bounces
    assert baked.effects & ~Effects.DENOISED == plan.effects == Effects.PUNCTUAL
    assert baked.scene == fingerprint(room())
    assert 0 < len(baked.gaussians) + len(baked.coarse or ()) <= plan.settings.budget


OWN_ROWS = {
    "over": {"SH degree": "0", "view size": "32 px", "fit": "2 steps"},
    "surface": {"SH degree": "0", "levels": "48 + 16", "samples": "4096", "fit": "2 steps"},
}


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_table_has_a_reason_for_everything_that_was_decided(small, operator):
    plan = of(small, operator=operator)
    rows = decisions(plan)
    assert all(row.why for row in rows if row.decision != "none")
    common = {"operator": operator, "point lights": "1", "environment": "none"}
    assert decided(plan) | common | OWN_ROWS[operator] == decided(plan)
    assert f"plan: {operator}, {plan.settings.bounces} bounces" in summary(plan)


@pytest.mark.parametrize(("operator", "change"), [("over", {"size": 320}), ("surface", {"budget": 1 << 13})])
def test_expected_memory_grows_with_what_is_held(small, operator, change):
    plan = of(small, operator=operator)
    more = of(plan, **change)
    assert more.points > 10 * plan.points
    assert more.memory - plan.memory > 50 * (more.points - plan.points)


def test_the_same_scene_gets_the_same_plan():
    first, again = planned(room()), planned(room())
    assert first.settings == again.settings
    assert first.pilot.lost == again.pilot.lost
    for name, camera in first.placement.fitted.items():
        np.testing.assert_array_equal(camera.world_from_view, again.placement.fitted[name].world_from_view)


@pytest.mark.parametrize("operator", OPERATORS)
def test_darkness_is_said_and_baked(operator):
    """Surfaces that reflect nothing: the target is met at once, and the file draws black."""
    plan = planned(room(albedo=0.0), replace(SMALL, operator=operator, target_loss=1e-6))
    references = {name: black(camera) for name, camera in plan.placement.held_out.items()}
    progress = Progress()
    baked = bake(plan, progress, references)
    assert "darkness" in progress.warnings[0]
    read = codec.decode(baked.data)
    assert baked.attempt.loss < 1e-6  # the denoiser leaves a trace of light
    assert (baked.attempt.count, len(baked.attempts)) == (len(read.gaussians) + len(read.coarse or ()), 1)
    assert read.tone_scale == 1
    if operator == "over":
        light = rasterise(read.gaussians, plan.cameras[0].pinhole(16, 16), read.blend)
    else:
        points = plan.triangles.draw(100, np.random.default_rng(0))
        light, _ = look_up(read.gaussians, read.coarse, read.blend, points.position, points.normal)
    assert not light.any()


def test_where_no_held_out_view_sees_a_b_there_is_no_search():
    plan = planned(room(albedo=0.0), replace(SMALL, target_loss=1e-6))
    baked = bake(plan, Progress(), {})
    assert [(fitted.loss, fitted.psnr) for fitted in baked.attempts] == [(None, None)]
    assert baked.data == bake(of(plan, target_loss=None), Progress()).data


@pytest.mark.parametrize(("operator", "size"), [("over", 198 + 12 * 64), ("surface", 1329)])
def test_what_a_scene_has_none_of_takes_no_bytes(small, operator, size):
    lit = room(environment=Environment(np.arange(24, dtype=np.float32).reshape(2, 4, 3)))
    assert (
        of(small, operator=operator).file_bytes == of(replace(small, scene=lit), operator=operator).file_bytes == size
    )
