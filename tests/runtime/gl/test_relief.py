"""The frame follows normal maps where the file says how the light does."""

from dataclasses import replace

import bumpy
import numpy as np
import pytest
import scenes
from frames import full_scene, surface_bake

from gsgi.baker.surface.lookup import look_up
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.renderer import DeferredRenderer

SIZE = 64


def bumpy_bake(seed: int = 4) -> Bake:
    """A bake whose light changes with the normal by up to its own brightness."""
    bake = surface_bake()
    relief = np.random.default_rng(seed).uniform(-0.3, 0.3, (len(bake.gaussians), 3, 3)).astype(np.float32)
    return replace(bake, gaussians=replace(bake.gaussians, relief=relief))


def drawn(gl, scene, bake, splat_scale: int = 1, layer: str = "indirect") -> np.ndarray:
    renderer = DeferredRenderer(gl, scene, bake, SIZE, SIZE, splat_scale)
    renderer.render(scenes.inside_camera())
    light = renderer.read(layer)
    renderer.release()
    return light


def test_the_pass_gives_what_the_look_up_does(gl):
    scene, bake = bumpy.bumpy_room(), bumpy_bake()
    seen = Tracer(scene).surface(scenes.inside_camera(), SIZE, SIZE)
    points = seen.position[seen.valid], seen.normal[seen.valid], seen.shading_normal[seen.valid]
    expected, flat = (look_up(bake.gaussians, bake.coarse, bake.blend, *some)[0] for some in (points, points[:2]))
    found = drawn(gl, scene, bake)[seen.valid]
    assert np.abs(expected - flat).mean() > 0.02
    assert np.median(np.abs(found - expected)) < 2e-3
    assert np.quantile(np.abs(found - expected), 0.99) < 0.03  # pixels at edges see another triangle


def test_a_scene_without_normal_maps_draws_the_same_with_and_without_relief(gl):
    scene = full_scene()
    flat = replace(scene, materials=tuple(replace(m, normal_texture=None) for m in scene.materials))
    bake = bumpy_bake()
    plain = replace(bake, gaussians=replace(bake.gaussians, relief=None))
    np.testing.assert_array_equal(drawn(gl, flat, bake), drawn(gl, flat, plain))


@pytest.mark.parametrize("splat_scale", [1, 2])
def test_relief_shows(gl, splat_scale):
    scene, bake = bumpy.bumpy_room(), bumpy_bake()
    plain = replace(bake, gaussians=replace(bake.gaussians, relief=None))
    assert np.abs(drawn(gl, scene, bake, splat_scale) - drawn(gl, scene, plain, splat_scale)).mean() > 0.02


def test_blended_surfaces_follow_normal_maps_as_solid_ones_do(gl):
    scene, bake = bumpy.bumpy_room(), bumpy_bake()
    films = tuple(mesh for mesh in scene.meshes if mesh.material == 1)
    stand_in = replace(scene.materials[1], stand_in=True)
    stands = tuple(replace(mesh, material=len(scene.materials)) for mesh in films)
    rest = tuple(mesh for mesh in scene.meshes if mesh.material != 1)
    blended = replace(scene, meshes=rest + stands, materials=(*scene.materials, stand_in), blended=films)
    plain = replace(bake, gaussians=replace(bake.gaussians, relief=None))
    expected, frame, flat = (
        drawn(gl, *some, layer="final") for some in ((scene, bake), (blended, bake), (blended, plain))
    )
    differ = np.abs(frame - expected) > 0.01 * expected + 1e-3
    assert differ.any(axis=2).mean() < 0.002
    assert (np.abs(flat - expected) > 0.01 * expected + 1e-3).any(axis=2).mean() > 0.02
