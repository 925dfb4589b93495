"""Weights of light groups on the GPU: what a bake, and a scene, of that light would show."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from frames import HEIGHT, WIDTH, full_scene, surface_bake
from gl_objects import alive
from glsl_lookup import read
from host import Host, drawn
from surface_cases import gaussians, grouped, points

import gsgi
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.indirect_lookup import IndirectLookup
from gsgi.runtime.gl.renderer import LAYERS, DeferredRenderer
from gsgi.runtime.light_groups import dimmed, factors_of, weighted
from gsgi.runtime.scene import Scene

WEIGHTS = {"lamps": 0.25, "sky": (1, 0.5, 2)}


def bake(offset: float = 0.0) -> Bake:
    fine, coarse = gaussians(200, sloped=True), gaussians(20, 9, seed=7)
    levels = [replace(g, position=(g.position + np.float32(offset)).astype(np.float32)) for g in (fine, coarse)]
    return grouped(Bake(levels[0], SurfaceBlend(floor=0.3), coarse=levels[1]))


def scene() -> Scene:
    """Its lamp and point light are of the group "lamps", its sky of "sky"; its other lights are of none."""
    full = full_scene()
    point, *others = full.lights
    return replace(full, lights=(replace(point, name="lamp 1"), *others))


def frame(ctx, lit: Scene, made: Bake, weights=None, splat_scale: int = 1, resize: bool = False) -> dict:
    renderer = DeferredRenderer(ctx, lit, made, WIDTH, HEIGHT, splat_scale)
    if weights is not None:
        renderer.weights = weights
    if resize:
        renderer.set_splat_scale(2)
        renderer.resize(WIDTH + 1, HEIGHT)
        renderer.resize(WIDTH, HEIGHT)
    renderer.render(scenes.inside_camera())
    layers = {layer: renderer.read(layer) for layer in LAYERS}
    renderer.release()
    return layers


def test_the_pass_shows_the_bake_of_that_light(gl):
    made, host = bake(), Host(gl)
    light, expected = (IndirectLight(gl, b, splat_scale=1) for b in (made, weighted(made, WEIGHTS)))
    before = drawn(light, gl, host)
    light.weights = WEIGHTS
    assert dict(light.weights) == factors_of(made, WEIGHTS)
    np.testing.assert_array_equal(drawn(light, gl, host), drawn(expected, gl, host))
    assert np.abs(drawn(light, gl, host) - before).max() > 0.1
    light.weights = {}
    np.testing.assert_array_equal(drawn(light, gl, host), before)
    light.release()
    expected.release()


@pytest.mark.parametrize("offset", [0.0, 4096.0])
def test_the_look_up_reads_the_bake_of_that_light(gl, offset):
    made, (position, normal) = bake(offset), points(500)
    position = (position + np.float32(offset)).astype(np.float32)
    lookup = IndirectLookup(gl, made)
    lookup.weights = WEIGHTS
    texels = lookup.textures.gaussians.read()
    assert texels == IndirectLookup(gl, weighted(made, WEIGHTS)).textures.gaussians.read()
    lookup.weights = {}
    assert lookup.textures.gaussians.read() == IndirectLookup(gl, made).textures.gaussians.read() != texels
    light = read(gl, weighted(made, WEIGHTS), position, normal)
    np.testing.assert_allclose(light, gsgi.sample(made, position, normal, WEIGHTS), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("weights", [WEIGHTS, {"lamps": 0, "base": 0, "sky": 0}, {"base": 3}])
def test_a_frame_dims_direct_light_too(gl, weights):
    made = grouped(surface_bake())
    named = scene()
    patterns = {group.name: group.patterns for group in made.groups if group.patterns}
    lit = dimmed(named, patterns, factors_of(made, weights))
    expected = frame(gl, lit, replace(weighted(made, weights), groups=()))
    found = frame(gl, named, made, weights)
    for layer in LAYERS:
        np.testing.assert_allclose(found[layer], expected[layer], rtol=2e-3, atol=1e-6, err_msg=layer)
    assert np.abs(found["primary"] - frame(gl, named, made)["primary"]).max() > 0.1


def test_weights_outlive_another_size_and_scale(gl):
    made = grouped(surface_bake())
    found, expected = (frame(gl, scene(), made, WEIGHTS, **how) for how in ({"resize": True}, {"splat_scale": 2}))
    for layer in LAYERS:
        np.testing.assert_array_equal(found[layer], expected[layer], err_msg=layer)


def test_weights_of_one_change_nothing(gl):
    made = grouped(surface_bake())
    plain = frame(gl, scene(), surface_bake())
    for weights in (None, {}, {"lamps": 1.0, "base": (1, 1, 1)}):
        found = frame(gl, scene(), made, weights)
        for layer in LAYERS:
            np.testing.assert_array_equal(found[layer], plain[layer], err_msg=layer)


def test_nothing_is_made_for_weights(gl):
    made = grouped(surface_bake())
    renderer = DeferredRenderer(gl, scene(), made, 16, 16)
    renderer.render(scenes.inside_camera())
    before = alive(gl)
    for value in (0.5, 0.0, 1.0):
        renderer.weights = {"lamps": value}
        renderer.render(scenes.inside_camera())
    assert alive(gl) == before
    renderer.release()


def test_unknown_groups_are_named(gl):
    for make in (IndirectLight, IndirectLookup):
        light = make(gl, bake())
        with pytest.raises(
            ValueError, match=r"^weights: the bake has no light group 'lamp': it has 'base', 'lamps', 'sky'"
        ):
            light.weights = {"lamp": 0}
        assert dict(light.weights) == factors_of(bake(), {})
        light.release()
    without = DeferredRenderer(gl, scene(), None, 8, 8)
    assert without.weights == {}
    with pytest.raises(ValueError, match=r"^weights: there is no bake"):
        without.weights = {"lamps": 0}
    without.release()
