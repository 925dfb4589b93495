"""The plan: what a scene calls for, and that a bake follows it."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker import plan as planning
from gsgi.baker.bake import bake
from gsgi.baker.cache import Cache
from gsgi.baker.decisions import decisions, summary
from gsgi.baker.detail import gaussians_for
from gsgi.baker.irradiance import Surface
from gsgi.baker.plan import PIXELS, PIXELS_PER_GAUSSIAN, SIZE_MAX, SIZE_MIN, Plan, make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.rasterise import rasterise
from gsgi.baker.reference import Reference
from gsgi.baker.settings import EFFECTS, QUALITIES, Settings
from gsgi.baker.surface_points import Triangles
from gsgi.baker.views import HELD_OUT
from gsgi.runtime import codec
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import SceneError
from gsgi.runtime.fingerprint import fingerprint
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.scene import Environment, Light, Material, Scene

SMALL = Settings(budget=64, views=4, size=32, samples=32, iterations=2)
LAMP = Light("point", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))


def room(albedo: float = 0.5, **changes) -> Scene:
    """A closed box with a lamp in its middle."""
    scene = Scene(tuple(scenes.box()), (Material("wall", (albedo, albedo, albedo, 1.0)),), lights=(LAMP,))
    return replace(scene, **changes)


def planned(scene: Scene, settings: Settings = SMALL, **arguments) -> Plan:
    return make_plan(scene, settings, Progress(quiet=True), Cache(), **arguments)


def black(camera: Camera) -> Reference:
    """A reference without light."""
    image, everywhere = np.zeros((16, 16, 3), np.float32), np.ones((16, 16), bool)
    up = np.tile(np.float32([0, 1, 0]), (16, 16, 1))
    surface = Surface(image, up, up, up, image, image, image[..., 0], everywhere, everywhere)
    return Reference(surface, image, image, image, everywhere)


def decided(plan: Plan) -> dict[str, str]:
    return {row.what: row.decision for row in decisions(plan)}


@pytest.fixture(scope="module")
def triangles() -> Triangles:
    return Triangles(room())


@pytest.mark.parametrize(("quality", "factor"), [("draft", 1 / 4), ("medium", 1), ("high", 4)])
def test_a_quality_is_so_many_gaussians_for_the_detail_of_the_scene(triangles, quality, factor):
    settings = Settings(quality=quality, views=1000, size=96)
    assert planning._budget(settings, triangles) == round(factor * gaussians_for(triangles, 0))


def test_there_are_no_more_gaussians_than_the_views_can_tell_apart(triangles):
    for quality in QUALITIES:
        settings = Settings(quality=quality, views=2, size=64)
        assert planning._budget(settings, triangles) == 2 * 64**2 // PIXELS_PER_GAUSSIAN


def test_a_budget_wins_over_the_quality(triangles):
    for quality in QUALITIES:
        for target in (None, 0.01):
            settings = replace(SMALL, budget=77, quality=quality, target_loss=target)
            assert planning._budget(settings, triangles) == 77


def test_a_search_may_go_as_far_as_high_quality(triangles):
    many = Settings(views=1000, size=96)
    high = planning._budget(replace(many, quality="high"), triangles)
    for quality in QUALITIES:
        assert planning._budget(replace(many, quality=quality, target_loss=0.01), triangles) == high


def test_a_search_is_told():
    plan = planned(room(), replace(SMALL, budget=None, target_loss=0.01))
    assert plan.settings.budget == plan.pixels // PIXELS_PER_GAUSSIAN
    (fit,) = (row for row in decisions(plan) if row.what == "fit")
    assert fit.why.endswith("again with more Gaussians until the held-out loss is 0.01")
    (fit,) = (row for row in decisions(replace(plan, settings=SMALL)) if row.what == "fit")
    assert "again" not in fit.why


def test_each_view_is_visited_so_often():
    for name, quality in QUALITIES.items():
        few, many = (planning._iterations(Settings(quality=name, views=views)) for views in (1, 10_000))
        assert (few, many) == (quality.steps, 10_000 * quality.visits)
        assert planning._iterations(Settings(quality=name, views=10_000, iterations=3)) == 3
    assert planning._iterations(Settings(views=1, iterations=0)) == 0
    draft, medium, high = QUALITIES.values()
    assert draft < medium < high
    assert all(a.visits < b.visits and a.steps < b.steps for a, b in ((draft, medium), (medium, high)))


@pytest.mark.parametrize("views", [1, 4, 411])
def test_the_target_does_not_change_how_long_a_fit_is(views):
    """Nor does the budget: a try of the search is the fit that its budget would get."""
    expected = planning._iterations(Settings(views=views))
    assert planning._iterations(Settings(views=views, target_loss=0.01)) == expected
    assert planning._iterations(Settings(views=views, budget=1)) == expected


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


def test_the_file_records_what_was_decided():
    scene = room(cameras={"own": scenes.inside_camera()})
    plan = planned(scene)
    baked = codec.decode(bake(plan, Progress(quiet=True)).data)
    assert baked.bounces == plan.settings.bounces
    assert baked.effects & ~Effects.DENOISED == plan.effects == Effects.PUNCTUAL
    assert baked.scene == fingerprint(scene)
    assert len(baked.gaussians) <= plan.settings.budget


def test_the_table_has_a_reason_for_everything_that_was_decided():
    plan = planned(room())
    rows = decisions(plan)
    assert all(row.why for row in rows if row.decision != "none")
    assert decided(plan) | {"point lights": "1", "environment": "none", "SH degree": "0"} == decided(plan)
    assert decided(plan)["view size"] == "32 px"
    assert f"{plan.settings.bounces} bounces" in summary(plan)


def test_expected_memory_grows_with_what_is_held():
    plan = planned(room())
    more = replace(plan, settings=replace(plan.settings, size=320))
    assert more.memory - plan.memory > 50 * (more.pixels - plan.pixels)


def test_the_same_scene_gets_the_same_plan():
    first, again = planned(room()), planned(room())
    assert first.settings == again.settings
    assert first.pilot.lost == again.pilot.lost
    for name, camera in first.placement.fitted.items():
        np.testing.assert_array_equal(camera.world_from_view, again.placement.fitted[name].world_from_view)


def test_darkness_is_said_and_baked(capsys):
    """Surfaces that reflect nothing: the target is met at once, and the file draws black."""
    plan = planned(room(albedo=0.0), replace(SMALL, target_loss=1e-6))
    references = {name: black(camera) for name, camera in plan.placement.held_out.items()}
    baked = bake(plan, Progress(quiet=True), references)
    assert "darkness" in capsys.readouterr().err
    read = codec.decode(baked.data)
    assert baked.fitted.loss < 1e-6  # the denoiser leaves a trace of light
    assert (baked.fitted.count, len(baked.tried)) == (len(read.gaussians), 1)
    assert read.tone_scale == 1
    assert not rasterise(read.gaussians, plan.cameras[0].pinhole(16, 16), read.blend).any()


def test_where_no_held_out_view_sees_a_b_there_is_no_search():
    plan = planned(room(albedo=0.0), replace(SMALL, target_loss=1e-6))
    baked = bake(plan, Progress(quiet=True), {})
    assert [(fitted.loss, fitted.psnr) for fitted in baked.tried] == [(None, None)]
    assert (
        baked.data == bake(replace(plan, settings=replace(plan.settings, target_loss=None)), Progress(quiet=True)).data
    )


def test_what_a_scene_has_none_of_takes_no_bytes():
    lit = room(environment=Environment(np.arange(24, dtype=np.float32).reshape(2, 4, 3)))
    assert planned(room()).file_bytes == planned(lit).file_bytes == 144 + 18 * SMALL.budget
