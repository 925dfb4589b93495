"""Frames follow the file: metals and panes are those of the bake."""

from dataclasses import replace

import numpy as np
import scenes
from gsgi_files import surface_example

from gsgi.baker.effects import effects
from gsgi.runtime.as_baked import as_baked
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.scene import Filter, Light, Material, Scene

METAL = Material("metal", metallic=1.0)
PANE = Material("pane", (1, 1, 1, 0.2), alpha_cutoff=0.1, filter=Filter(blends=True, clear=np.inf), stand_in=True)
SUN = Light("directional", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))


def with_effects(found: Effects):
    bake = surface_example()
    return replace(bake, effects=found)


def test_metals_are_those_of_the_bake():
    scene = Scene((scenes.floor(),), (METAL,))
    assert as_baked(scene, with_effects(Effects(0))).metals == "black"
    assert as_baked(scene, with_effects(Effects.METAL)).metals == "rough"
    for metals in ("rough", "black"):
        assert as_baked(replace(scene, metals=metals), None).metals == metals


def test_panes_cast_shadows_where_the_light_behind_them_is_in_b():
    scene = Scene((scenes.floor(), scenes.floor(1.0, 1.0, 1)), (scenes.WHITE, PANE), lights=(SUN,))
    for bake, cutoff in ((None, np.inf), (with_effects(Effects.CLEAR_PANE), np.inf), (with_effects(Effects(0)), 0.1)):
        assert [m.shadow_cutoff for m in as_baked(scene, bake).materials] == [None, cutoff]


def test_a_bake_says_so_where_a_lamp_shines_through_a_clear_pane():
    scene = Scene((scenes.floor(), scenes.floor(1.0, 1.0, 1)), (scenes.WHITE, PANE), lights=(SUN,))
    assert Effects.CLEAR_PANE in effects(scene)
    dim = replace(PANE, filter=Filter(blends=True))
    for other in (replace(scene, lights=()), replace(scene, materials=(scenes.WHITE, dim))):
        assert Effects.CLEAR_PANE not in effects(other)
