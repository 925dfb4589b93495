"""Scenes far from the world's origin."""

from dataclasses import replace

import numpy as np
import oracle
import scenes

from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.rebase import local_bake, local_camera, local_scene, origin_of
from gsgi.runtime.scene import Light, Scene

AWAY = np.array([2.0**17, 0.0, -(2.0**16)])  # m; multiples of what float32 resolves there, as the scene below


def room() -> Scene:
    """A box with a block in it, all corners on multiples of 1/64 m, and a lamp."""
    block = [replace(m, position=m.position - np.float32([0, 0.75, 0.375])) for m in scenes.box(0.25, inward=False)]
    lamp = Light("point", np.ones(3), np.array([0.5, 0.6, 0.2]), np.zeros(3))
    return Scene((*scenes.box(), *block), (scenes.WHITE,), lights=(lamp,))


def draw(gl, scene: Scene, bake: Bake, camera) -> dict[str, np.ndarray]:
    renderer = DeferredRenderer(gl, scene, bake, 64, 48)
    renderer.render(camera)
    layers = {layer: renderer.read(layer) for layer in LAYERS}
    renderer.release()
    return layers


def test_only_a_far_scene_is_moved():
    assert not origin_of(room()).any()
    assert not origin_of(local_scene(room(), -np.array([40.0, 0, 0]))).any()
    assert np.array_equal(origin_of(local_scene(room(), -AWAY)), AWAY)


def test_a_far_scene_looks_as_it_does_at_the_origin(gl):
    bake = Bake(oracle.random_gaussians(200, 1, seed=1), OverBlend(near=0.1))
    position = np.round(bake.gaussians.position * 64) / 64
    bake = replace(bake, gaussians=replace(bake.gaussians, position=position.astype(np.float32)))
    near = draw(gl, room(), bake, scenes.inside_camera())
    far = draw(gl, local_scene(room(), -AWAY), local_bake(bake, -AWAY), local_camera(scenes.inside_camera(), -AWAY))
    for layer in LAYERS:
        assert near[layer].any(), layer
        np.testing.assert_allclose(far[layer], near[layer], rtol=1e-3, atol=1e-4, err_msg=layer)


def test_both_levels_of_a_bake_are_moved():
    fine, coarse = oracle.random_gaussians(20, 0, seed=1), oracle.random_gaussians(5, 2, seed=2)
    moved = local_bake(Bake(fine, SurfaceBlend(), coarse=coarse), -AWAY)
    for before, after in [(fine, moved.gaussians), (coarse, moved.coarse)]:
        assert np.array_equal(after.position, (before.position + AWAY).astype(np.float32))
        assert after.sh is before.sh
    assert local_bake(Bake(fine, OverBlend(near=0.1)), -AWAY).coarse is None
