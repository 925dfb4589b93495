"""Effects are found, can be left out, and cost nothing where the scene has none of them."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.effects import NAMES, effects, findings, without
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.scene import Environment, Filter, Light, Material, Scene, Texture, TextureSlot

LAMP = Light("point", np.ones(3), np.array([0.0, 2.0, 0.0]), np.array([0.0, -1.0, 0.0]))
SKY = Environment(np.ones((1, 1, 3), np.float32))
PICTURE = Environment(np.arange(24, dtype=np.float32).reshape(2, 4, 3))
PLAIN = Scene((scenes.floor(),), (scenes.WHITE,), textures=(Texture(np.full((2, 2, 4), 200, np.uint8)),))


def material(**changes) -> Scene:
    return replace(PLAIN, materials=(replace(scenes.WHITE, **changes),))


SCENES = {
    "punctual": replace(PLAIN, lights=(LAMP,)),
    "emissive": material(emission=(1.0, 1.0, 1.0)),
    "environment": replace(PLAIN, environment=PICTURE),
    "alpha-mask": material(alpha_cutoff=0.5, base_color_texture=TextureSlot(0)),
    "double-sided": material(double_sided=True),
    "normal-map": material(normal_texture=TextureSlot(0)),
    "unlit": material(unlit=True),
}


@pytest.mark.parametrize("name", SCENES)
def test_each_effect_is_found_alone_and_can_be_left_out(name):
    assert effects(SCENES[name]) == NAMES[name]
    assert effects(without(SCENES[name], [name])) == Effects(0)
    assert effects(without(SCENES[name], set(NAMES) - {name})) == NAMES[name]


def test_a_plain_scene_has_no_effect_and_no_cost():
    assert effects(PLAIN) == Effects(0)
    assert {(finding.found, finding.cost) for finding in findings(PLAIN)} == {("none", "")}


def test_findings_say_how_much_of_it_and_what_it_costs():
    found = {finding.name: finding for finding in findings(SCENES["emissive"])}["emissive surfaces"]
    assert found.found == "2 triangles"
    assert "ray" in found.cost
    assert found.cost.endswith("(white)")
    lights = {f.name: f.found for f in findings(replace(PLAIN, lights=(LAMP, LAMP, replace(LAMP, kind="spot"))))}
    assert (lights["point lights"], lights["spot lights"], lights["directional lights"]) == ("2", "1", "none")


def test_materials_that_no_triangle_has_call_for_nothing():
    unused = replace(PLAIN, materials=(scenes.WHITE, Material(emission=(1, 1, 1), alpha_cutoff=0.5, double_sided=True)))
    assert effects(unused) == Effects(0)


def ray_casts(scene: Scene) -> int:
    """How many places of the path tracer's kernel cast a ray."""
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        tracer, point = Tracer(scene), np.zeros((1, 3), np.float32)
        dr.kernel_history_clear()
        tracer.indirect(point, np.float32([[0, 1, 0]]), np.float32([[0, 1, 0]]), Sampling(32), seed=0)
        kernels = [k["ir"].getvalue() for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
    return sum(len(re.findall(r"call void %rd\d+\(ptr %u\d+_in", ir)) for ir in kernels)


@pytest.mark.parametrize(
    ("scene", "casts"),
    [
        (replace(PLAIN, environment=SKY), 1),  # the path's own ray
        (SCENES["environment"], 2),  # and one towards the environment
        (SCENES["emissive"], 2),
        (SCENES["punctual"], 2),
        (replace(SCENES["punctual"], environment=PICTURE), 3),
        (replace(SCENES["alpha-mask"], environment=SKY), 1),  # only masked triangles: still one ray, in a loop
        (replace(SCENES["double-sided"], environment=SKY), 1),
        (replace(SCENES["normal-map"], environment=SKY), 1),
    ],
)
def test_the_kernel_casts_rays_for_the_effects_that_are_there(scene, casts):
    assert ray_casts(scene) == 1 + casts  # one finds the triangle that a point lies on


def test_an_absent_effect_looks_nothing_up():
    tracer = Tracer(replace(PLAIN, environment=SKY))
    shading = tracer.shading
    assert not any((shading.slots, shading.smooth, shading.colored, shading.metallic, shading.double_sided))
    assert shading.channels == len(shading.texels) == tracer.emitters.count == tracer.lights.count == 0
    assert tracer.masked is None
    assert not tracer.unlit


def test_materials_that_let_light_through_are_found():
    glass = Material("glass", filter=Filter(transmission=0.9), stand_in=True)
    scene = replace(PLAIN, materials=(glass,), transparent=('"glass" transmits light',))
    (found,) = [finding for finding in findings(scene) if finding.name == "transparent"]
    assert found.found == "1 materials"
    assert "let light through" in found.cost
    assert found.cost.endswith("behind them (glass)")
    clear = replace(scene, materials=(replace(glass, filter=Filter(transmission=0.9, clear=np.inf)),))
    (found,) = [finding for finding in findings(clear) if finding.name == "transparent"]
    assert found.cost.endswith("; what is clear is to cast no shadow (glass)")
    holes = replace(scene, materials=(replace(glass, filter=None),))
    assert [finding.cost for finding in findings(holes) if finding.name == "transparent"] == ['"glass" transmits light']
