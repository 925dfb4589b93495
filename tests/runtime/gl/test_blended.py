"""Partly transparent surfaces in a frame: blended in depth order, lit as solid ones are, with B looked up at each."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from frames import HEIGHT, WIDTH, bake, full_scene, surface_bake
from gl_objects import alive
from gsgi_files import constant
from primary_error import primary_error

from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import BLENDED_MOST, Environment, Filter, Light, Material, Scene

SIZE = 12
UP = np.array([0.0, 1.0, 0.0])
AHEAD = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), UP, 1.0, 0.01)


def shown(color, opacity: float) -> Material:
    """A surface that shows its colour as radiance."""
    return Material("film", (*color, opacity), unlit=True, double_sided=True)


def wall(depth: float, material: int, right_depth: float | None = None):
    """Across the view, `depth` metres away on the left and `right_depth` on the right."""
    far = depth if right_depth is None else right_depth
    return scenes.quad([(-9, -9, -depth), (9, -9, -far), (9, 9, -far), (-9, 9, -depth)], material)


def final(gl, scene: Scene, baked=None, camera=AHEAD, size=(SIZE, SIZE)) -> np.ndarray:
    renderer = DeferredRenderer(gl, scene, baked, *size)
    renderer.render(camera)
    frame = renderer.read("final")
    renderer.release()
    return frame


def over(*films) -> np.ndarray:
    """Radiance of films (colour, opacity), the nearest first; the last is solid."""
    radiance = np.zeros(3)
    for color, opacity in reversed(films):
        radiance = opacity * np.asarray(color) + (1 - opacity) * radiance
    return radiance


RED, GREEN, BLUE = (1.0, 0.1, 0.0), (0.0, 0.8, 0.2), (0.1, 0.3, 2.0)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_films_blend_by_depth_in_any_order_of_the_file(gl, order):
    materials = shown(RED, 0.25), shown(GREEN, 0.6), shown(BLUE, 1.0)
    films = [wall(1.0, 0), wall(2.0, 1)]
    frame = final(gl, Scene((wall(3.0, 2),), materials, blended=tuple(films[k] for k in order)))
    expected = over((RED, 0.25), (GREEN, 0.6), (BLUE, 1))
    np.testing.assert_allclose(frame, np.broadcast_to(expected, frame.shape), rtol=2e-3)


def test_films_that_cross_blend_by_the_depth_of_each_pixel(gl):
    materials = shown(RED, 0.25), shown(GREEN, 0.6)
    frame = final(gl, Scene((), materials, blended=(wall(1.0, 0, 3.0), wall(3.0, 1, 1.0))))
    np.testing.assert_allclose(frame[:, 0], np.tile(over((RED, 0.25), (GREEN, 0.6)), (SIZE, 1)), rtol=2e-3)
    np.testing.assert_allclose(frame[:, -1], np.tile(over((GREEN, 0.6), (RED, 0.25)), (SIZE, 1)), rtol=2e-3)


def test_what_is_behind_a_solid_surface_is_hidden_and_a_decal_in_its_plane_is_not(gl):
    materials = shown(RED, 0.25), shown(BLUE, 1.0)
    behind, flush = (final(gl, Scene((wall(2.0, 1),), materials, blended=(wall(depth, 0),))) for depth in (2.1, 2.0))
    np.testing.assert_allclose(behind, np.broadcast_to(BLUE, behind.shape), rtol=1e-3)
    np.testing.assert_allclose(flush, np.broadcast_to(over((RED, 0.25), (BLUE, 1)), flush.shape), rtol=2e-3)


def test_the_nearest_films_count_and_the_sky_is_behind_all(gl):
    materials = tuple(shown((0.5 * k, 1.0, 0.2), 0.5) for k in range(BLENDED_MOST + 2))
    films = tuple(wall(1.0 + k, k) for k in range(BLENDED_MOST + 2))
    sky = (3.0, 2.0, 1.0)
    frame = final(gl, Scene((), materials, blended=films, environment=Environment(np.full((1, 1, 3), sky, np.float32))))
    expected = over(*[(materials[k].base_color[:3], 0.5) for k in range(BLENDED_MOST)], (sky, 1))
    np.testing.assert_allclose(frame, np.broadcast_to(expected, frame.shape), rtol=3e-3)


@pytest.mark.parametrize("offset", [0.0, 1e4])
@pytest.mark.parametrize("material", [1, 2])
def test_at_full_opacity_it_looks_as_a_solid_surface_does(gl, material, offset):
    """Under every kind of light and B, with and without normal map and texture, near the origin and far from it."""
    scene, light = full_scene(), surface_bake()
    at = np.float32([offset, 0, 0])
    levels = [replace(level, position=level.position + at) for level in (light.gaussians, light.coarse)]
    light = replace(light, gaussians=levels[0], coarse=levels[1])
    materials = [replace(m, alpha_cutoff=None, double_sided=True) for m in scene.materials]
    materials[1] = replace(materials[1], base_color_texture=None)  # whose alpha is not 1
    scene = replace(
        scene,
        materials=tuple(materials),
        meshes=tuple(replace(m, position=m.position + at) for m in scene.meshes),
        lights=tuple(replace(lamp, position=lamp.position + at.astype(float)) for lamp in scene.lights),
    )
    part = tuple(mesh for mesh in scene.meshes if mesh.material == material)
    rest = tuple(mesh for mesh in scene.meshes if mesh.material != material)
    stand_in = replace(materials[material], stand_in=True)
    stands = tuple(replace(mesh, material=len(materials)) for mesh in part)
    blended = replace(scene, meshes=rest + stands, materials=(*materials, stand_in), blended=part)
    camera = scenes.inside_camera()
    pose = camera.world_from_view.copy()
    pose[:3, 3] += at
    camera = replace(camera, world_from_view=pose)
    expected, frame = (final(gl, each, light, camera, (WIDTH, HEIGHT)) for each in (scene, blended))
    without = final(gl, replace(blended, blended=()), light, camera, (WIDTH, HEIGHT))
    assert (np.abs(without - expected).max(axis=2) > 0.01).mean() > 0.02, "the surface is seen"
    differ = np.abs(frame - expected) > 0.01 * expected + 1e-3
    assert differ.any(axis=2).mean() < (0.002 if not offset else 0.01)


def test_b_is_looked_up_at_the_film(gl):
    """A white film of opacity 0.5 before black, in light of B = (2, 1, 0.5) from everywhere."""
    film, black = Material("film", (1.0, 1.0, 1.0, 0.5)), Material("black", (0.0, 0.0, 0.0, 1.0))
    scene = Scene((wall(3.0, 1),), (film, black), blended=(wall(1.0, 0),))
    frame = final(gl, scene, constant([2.0, 1.0, 0.5]))
    np.testing.assert_allclose(frame, np.broadcast_to([1.0, 0.5, 0.25], frame.shape), rtol=3e-3)
    assert not final(gl, scene, constant([2.0, 1.0, 0.5], "over")).any(), "`over` is no function of a point"


def test_glass_tints_what_is_behind_it_and_clear_films_do_not(gl):
    glass = Material("glass", (0.5, 1.0, 0.25, 0.0), double_sided=True, tint=1.0)
    half = Material("half", (0.5, 1.0, 0.25, 0.5), double_sided=True, tint=0.5)
    materials = shown(BLUE, 1.0), glass, half, shown(RED, 0.25)
    blended = tuple(wall(1.0 + k, 1 + k) for k in range(3))
    frame = final(gl, Scene((wall(5.0, 0),), materials, blended=blended))
    behind = over((RED, 0.25), (BLUE, 1)) * 0.5 * np.array([0.75, 1.0, 0.625])
    np.testing.assert_allclose(frame, np.broadcast_to(behind * [0.5, 1.0, 0.25], frame.shape), rtol=3e-3)


@pytest.mark.parametrize(("transmission", "seen"), [(0.3, True), (0.7, False)])
def test_direct_light_and_what_cameras_see_are_those_of_the_path_tracer(gl, transmission, seen):
    """A pane in the sun: its shadow is dark in both, as light through it is B, and both see through it or not."""
    sun = Light("directional", np.full(3, 2.0), np.zeros(3), np.array([0.6, -0.8, 0.0]))
    glass = Material(
        "glass", (0.2, 0.9, 0.4, 1.0), double_sided=True, stand_in=True, filter=Filter(False, transmission)
    )
    drawn = replace(glass, stand_in=False, filter=None, base_color=(0.2, 0.9, 0.4, 1 - transmission), tint=1.0)
    pane = scenes.floor(0.5, 0.5, 1)
    meshes = scenes.floor(4.0), pane
    scene = Scene(meshes, (scenes.WHITE, glass, drawn), lights=(sun,), blended=(replace(pane, material=2),))
    error = primary_error(gl, scene, scenes.above_camera(), 96, 96)
    assert error.lit.sum() > 300
    assert error.wrong < 0.01
    frame = final(gl, scene.as_traced(), camera=scenes.above_camera(), size=(96, 96))
    assert (frame[48, 48, 1] > 2 * frame[48, 48, 0]) == seen


def test_a_stand_in_throws_the_shadow_and_is_not_seen(gl):
    sun = Light("directional", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    lid = replace(scenes.floor(0.5, 1.0), material=1)
    stand_in = Material("glass", stand_in=True)
    scene = Scene((scenes.floor(4.0), lid), (scenes.WHITE, stand_in), lights=(sun,))
    frame = final(gl, scene, camera=scenes.above_camera(), size=(64, 64))
    expected = 0.5 / np.pi
    np.testing.assert_allclose(frame[4, 4], expected, rtol=2e-3)
    assert not frame[32, 32].any(), "in the shadow of the glass, which is not drawn"
    traced = final(gl, scene.as_traced(), camera=scenes.above_camera(), size=(64, 64))
    np.testing.assert_allclose(traced[32, 32], 1 / np.pi, rtol=2e-3)


@pytest.mark.parametrize("baked", [None, bake(), surface_bake()])
def test_it_is_made_where_needed_resized_and_released(gl, baked):
    before = alive(gl)
    plain = DeferredRenderer(gl, full_scene(), baked, 8, 8)
    assert plain.blended is None
    plain.release()
    scene = full_scene()
    films = tuple(replace(mesh, material=0) for mesh in scenes.box(0.5))
    renderer = DeferredRenderer(gl, replace(scene, blended=films), baked, 8, 8)
    renderer.render(scenes.inside_camera())
    renderer.resize(9, 7)
    renderer.render(scenes.inside_camera())
    assert renderer.read("final").shape == (7, 9, 3)
    renderer.release()
    assert alive(gl) == before
