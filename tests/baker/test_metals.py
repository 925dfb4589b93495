"""Metals from the plan to the frame: rough ones by default, black ones on request."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from gsgi_files import constant
from repository import SCENES
from small_tasks import place_quickly

from gsgi.baker.cache.digest import scene_digest
from gsgi.baker.cache.store import Cache
from gsgi.baker.cli.console import Console
from gsgi.baker.effects import effects, findings
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.trace import reference
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.errors import UsageError
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.metals import metal_areas
from gsgi.runtime.scene import Environment, Material, Scene

SIZE = 48


def metal_furnace(albedo: float, metallic: float = 1.0):
    """A closed cube of metal whose walls emit 1.5."""
    furnace = scenes.furnace(albedo, emission=1.5)
    return replace(furnace, materials=(replace(furnace.materials[0], metallic=metallic),))


@pytest.mark.parametrize("metallic", [0.5, 1.0])
@pytest.mark.parametrize("albedo", [0.5, 0.8])
def test_a_furnace_of_metal_holds_as_much_light_as_any_other(albedo, metallic):
    furnace, metal = scenes.furnace(albedo, emission=1.5), metal_furnace(albedo, metallic)
    surface = Tracer(metal).surface(scenes.inside_camera(), 24, 16)
    light = Tracer(metal).indirect(*surface.points(), Sampling(256), seed=1).mean
    # 384 points x 256 paths of sd < 1.0 per path: standard error below 0.004; corners make the tails heavy.
    assert light.mean() == pytest.approx(1.5 / (1 - albedo), rel=0.01)
    np.testing.assert_array_equal(light, Tracer(furnace).indirect(*surface.points(), Sampling(256), seed=1).mean)


@pytest.fixture(scope="module")
def room():
    return read_gltf(SCENES / "metals.glb")


def metals_row(scene) -> list[tuple[str, str]]:
    return [(finding.found, finding.cost) for finding in findings(scene) if finding.name == "metals"]


def test_effects_keys_and_findings_tell_rough_from_black(room):
    black = replace(room, metals="black")
    assert effects(room) == Effects.PUNCTUAL | Effects.METAL
    assert effects(black) == Effects.PUNCTUAL
    assert scene_digest(room) != scene_digest(black)
    (rough_row,), (black_row,) = metals_row(room), metals_row(black)
    areas, area = metal_areas(room)
    assert rough_row[0] == f"{areas.sum() / area:.1%} of all surface"
    assert rough_row[1] == "reflect as rough ones would on average, diffusely (steel, copper tiles, gold)"
    assert black_row[1].startswith("reflect nothing")
    assert metals_row(scenes.furnace()) == []


def test_an_unknown_way_to_reflect_is_refused():
    with pytest.raises(UsageError, match="metals: expected one of rough, black, got 'shiny'"):
        Settings(metals="shiny")


@pytest.mark.parametrize("metals", ["rough", "black"])
def test_the_plan_makes_the_choice(monkeypatch, metals):
    place_quickly(monkeypatch.setattr)
    sky = Environment(np.ones((1, 1, 3), np.float32))
    floor = Scene((scenes.floor(),), (Material("steel", (0.5, 0.5, 0.5, 1.0), metallic=1.0),), environment=sky)
    settings = Settings(metals=metals, views=1, bounces=1, budget=100)
    plan = make_plan(floor, settings, Progress(Console(quiet=True)), Cache())
    assert plan.scene.metals == metals
    assert (Effects.METAL in plan.effects) == (metals == "rough")


@pytest.mark.parametrize(("effects", "metals"), [(Effects.METAL, "rough"), (Effects.EMISSIVE, "black")])
def test_the_frame_draws_the_metals_that_were_baked(gl, effects, metals):
    """A glowing box of metal. Whatever the scene says of metals, a file's light belongs to its own."""
    box, light = metal_furnace(0.5), 1.5 / (1 - 0.5)
    renderer = DeferredRenderer(gl, box, replace(constant([light] * 3), effects=effects), SIZE, SIZE)
    renderer.render(box.cameras["inside"])
    final = renderer.read("final")
    renderer.release()
    truth = reference.trace(Tracer(replace(box, metals=metals)), box.cameras["inside"], SIZE, SIZE, 256, seed=0)
    assert final.mean() == pytest.approx(truth.final.mean(), rel=0.01)
    np.testing.assert_allclose(final, light if metals == "rough" else 1.5, rtol=2e-3)
