"""Shadows against closed forms: whole where a blocker stands, none where nothing does, at every scale."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gl.shadow import casters_of, faces_of
from gsgi.runtime.scene import Filter, Light, Material, Mesh, Scene, Texture, TextureSlot

SIZE = 128
SCALES = [0.005, 0.5, 30.0, 1000.0]
DOWN = np.array([0.0, -1.0, 0.0])


def scaled(mesh, scale):
    return Mesh(mesh.position * np.float32(scale), mesh.normal, mesh.uv, mesh.triangle, mesh.material)


def draw(gl, meshes, light, camera, materials=(scenes.WHITE,), textures=()):
    renderer = DeferredRenderer(gl, Scene(tuple(meshes), materials, textures, (light,)), None, SIZE, SIZE)
    renderer.render(camera)
    primary, normal, depth = (renderer.read(layer) for layer in ("primary", "normal", "depth"))
    renderer.release()
    return primary[..., 0], normal, depth


def points_of(depth, camera):
    pinhole = camera.pinhole(SIZE, SIZE)
    slope = (np.arange(SIZE) + 0.5 - pinhole.cx) / pinhole.fx
    ray = np.stack(np.broadcast_arrays(slope[None, :], -slope[:, None], -1.0), axis=-1)
    return (ray * depth[..., None]) @ camera.world_from_view[:3, :3].T + camera.position


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("kind", ["point", "spot"])
def test_an_empty_box_has_no_shadow(gl, scale, kind):
    position = np.array([0.5, 0.7, -0.3]) * scale
    axis = np.array([-0.6, -0.8, 0.0])
    light = Light(kind, np.ones(3) * scale**2, position, axis, cos_inner=0.9, cos_outer=0.6)
    camera = scenes.inside_camera()
    pose = camera.world_from_view.copy()
    pose[:3, 3] *= scale
    camera = type(camera)(pose, camera.yfov, 0.001 * scale)
    primary, normal, depth = draw(gl, [scaled(wall, scale) for wall in scenes.box()], light, camera)
    offset = position - points_of(depth, camera)
    d = np.linalg.norm(offset, axis=-1)
    wi = offset / d[..., None]
    irradiance = scale**2 / d**2 * np.maximum(0, (normal * wi).sum(axis=-1))
    if kind == "spot":
        irradiance *= np.clip((-wi @ axis - 0.6) / 0.3, 0, 1) ** 2
    wrong = np.abs(primary - 0.5 / np.pi * irradiance) > 0.01 * irradiance + 1e-3
    # Within a texel of a corner, the filter sees the other wall.
    assert wrong.mean() < 1e-3


def blocker_above_floor(scale, height, materials=1):
    """A square of edge 0.4 that hovers over a floor of edge 4; the second material is the blocker's."""
    return [scaled(scenes.floor(2.0), scale), scaled(scenes.floor(0.2, height, materials - 1), scale)]


def above(scale):
    """Looks from the side below the blocker's height, so that the whole shadow shows."""
    eye = np.array([0.0, 0.35, 1.2]) * scale
    return look_at(eye, np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.001 * scale)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_the_shadow_of_a_square_has_the_right_size(gl, scale, kind):
    height, top = 0.5, 2.0
    light = Light(kind, np.ones(3) * scale**2, top * scale * -DOWN, DOWN, cos_inner=0.9, cos_outer=0.7)
    camera = above(scale)
    primary, normal, depth = draw(gl, blocker_above_floor(scale, height), light, camera)
    half = 0.2 * (1.0 if kind == "directional" else top / (top - height)) * scale
    points = points_of(depth, camera)
    floor = (depth > 0) & (np.abs(points[..., 1]) < 1e-3 * scale) & (normal[..., 1] > 0.9)
    edge = np.maximum(np.abs(points[..., 0]), np.abs(points[..., 2])) - half
    texel = 0.005 * scale
    inside, outside = floor & (edge < -texel), floor & (edge > texel) & (edge < half)
    assert inside.sum() > 100
    assert outside.sum() > 100
    assert not primary[inside].any()
    assert (primary[outside] > 0).all()


@pytest.mark.parametrize("scale", SCALES)
def test_a_standing_block_keeps_contact_with_its_shadow(gl, scale):
    block = [scaled(Mesh(m.position + np.float32([0, 0.2, 0]), m.normal, m.uv, m.triangle, 0), scale)
             for m in scenes.box(0.2, inward=False)]  # fmt: skip
    axis = np.array([0.8, -0.6, 0.0])
    light = Light("directional", np.ones(3), np.zeros(3), axis)
    camera = look_at(
        np.array([0.6, 1.0, 0.9]) * scale, np.array([0.3, 0, 0]) * scale, np.array([0.0, 1, 0]), 0.7, 0.001 * scale
    )
    primary, normal, depth = draw(gl, [scaled(scenes.floor(2.0), scale), *block], light, camera)
    x, y, z = np.moveaxis(points_of(depth, camera), -1, 0) / scale
    floor = (np.abs(y) < 1e-3) & (normal[..., 1] > 0.9)
    shadow = floor & (x > 0.2) & (x < 0.2 + 0.4 / 0.75 - 0.01) & (np.abs(z) < 0.19)
    assert shadow.sum() > 300
    assert (x[shadow] < 0.21).any()
    assert not primary[shadow].any()


def test_a_single_sided_wall_stops_light_from_behind(gl):
    upside_down = scenes.floor(0.5, 0.5)
    flipped = Mesh(upside_down.position, -upside_down.normal, upside_down.uv, upside_down.triangle[:, ::-1].copy(), 0)
    light = Light("directional", np.ones(3), np.zeros(3), DOWN)
    camera = look_at(np.array([0.0, 3.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.2, 0.01)
    primary, _, depth = draw(gl, [scenes.floor(), flipped], light, camera)
    assert np.allclose(depth, 3, atol=1e-4)
    assert not primary.any()


@pytest.mark.parametrize(("kind", "most"), [("directional", 0.003), ("point", 0.015)])
def test_little_light_leaks_in_where_walls_without_thickness_meet(gl, kind, most):
    rng, leaked = np.random.default_rng(0), []
    for _ in range(20):
        direction = rng.normal(size=3) * (1, 0, 1) - (0, rng.uniform(0.2, 2), 0)
        direction /= np.linalg.norm(direction)
        light = Light(kind, np.ones(3), -4 * direction, direction)
        corner = np.array([rng.choice([-1, 1]), -1.0, rng.choice([-1, 1])])
        camera = look_at(0.97 * corner, corner, np.array([0.0, 1.0, 0.0]), 1.2, 0.001)
        primary, _, depth = draw(gl, scenes.box(), light, camera)
        assert depth.all()
        leaked.append((primary > 0).mean())
    assert np.mean(leaked) < most


def test_the_suns_map_covers_what_can_cast_a_shadow(gl):
    """A square above wide ground, which itself casts none: its shadow is as sharp as above a small floor."""
    ground, (_, square) = scenes.floor(200.0), blocker_above_floor(1.0, 0.5, 1)
    slanted = np.array([0.6, -0.8, 0.0])
    meshes, corners = (
        (ground, square),
        np.float64([[x, y, z] for x in (-200, 200) for y in (0, 0.5) for z in (-200, 200)]),
    )
    casters = casters_of(meshes, slanted, corners)
    np.testing.assert_array_equal(np.unique(casters, axis=0), np.unique(square.position, axis=0))
    np.testing.assert_array_equal(casters_of(meshes, -slanted, corners)[:4], ground.position)  # from below, it is first
    np.testing.assert_array_equal(casters_of((ground,), slanted, corners[::2]), corners[::2])
    light = Light("directional", np.ones(3), np.zeros(3), slanted)
    assert faces_of(light, corners, casters).texel_size[0] < 2e-4
    camera = above(1.0)
    wide, small = (draw(gl, (floor, square), light, camera)[0] for floor in (ground, scenes.floor(2.0)))
    _, _, depth = draw(gl, (ground, square), light, camera)
    near = np.abs(points_of(depth, camera)[..., [0, 2]]).max(axis=-1) < 1.9
    assert (wide[near] > 0).any()
    assert (wide[near] == 0).any()
    assert (np.abs(wide - small)[near] > 1e-3).mean() < 2e-3
    beyond = (depth > 0) & ~near
    np.testing.assert_allclose(wide[beyond], 0.8 * 0.5 / np.pi, rtol=1e-3)


@pytest.mark.parametrize("thickness", [0.0, 1e-4, 1e-3])
@pytest.mark.parametrize("kind", ["directional", "point", "spot"])
def test_a_thin_plate_is_lit(gl, kind, thickness):
    """Its back is nearer to its front than the edge of a texel."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    plate = [scenes.quad([(x, y, z) for x, z in corners[::turn]], 0) for y, turn in ((0.1, -1), (0.1 - thickness, 1))]
    camera = above(1.0)
    for slope in (0.0, 0.5, 1.0, 3.0):
        towards = np.array([-slope, 1.0, -0.3 * slope])
        direction = -towards / np.linalg.norm(towards)
        aim = DOWN if kind == "point" else direction
        light = Light(kind, np.ones(3), 1.5 * towards, aim, cos_inner=0.7, cos_outer=0.6)
        primary, normal, depth = draw(gl, [scenes.floor(2.0), *plate], light, camera)
        points = points_of(depth, camera)
        on_top = (np.abs(points[..., 1] - 0.1) < 1e-3) & (normal[..., 1] > 0.9)
        offset = light.position - points
        distance = np.linalg.norm(offset, axis=-1)
        irradiance = offset[..., 1] / distance**3 if kind != "directional" else -direction[1]
        within = kind != "spot" or (-offset / distance[..., None]) @ direction > 0.72
        counts = on_top & within & (np.abs(points[..., [0, 2]]).max(axis=-1) < 0.95)
        assert counts.sum() > 500
        assert np.abs(primary * 2 * np.pi / irradiance - 1)[counts].max() < 0.02


def test_light_falls_through_the_holes_of_a_mask(gl):
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, 0, 3] = 0
    materials = scenes.WHITE, Material(base_color_texture=TextureSlot(0), alpha_cutoff=0.5)
    textures = (Texture(pixels, ("clamp", "clamp")),)
    assert_the_left_half_is_a_hole(gl, blocker_above_floor(1.0, 0.5, 2), materials, textures)


def test_light_falls_through_where_vertex_colors_are_transparent(gl):
    floor, blocker = blocker_above_floor(1.0, 0.5, 2)
    color = np.ones((4, 4), np.float32)
    color[:, 3] = blocker.position[:, 0] > 0
    meshes = floor, replace(blocker, color=color)
    assert_the_left_half_is_a_hole(gl, meshes, (scenes.WHITE, Material(alpha_cutoff=0.5)))


def test_what_is_clear_casts_no_shadow(gl):
    floor, blocker = blocker_above_floor(1.0, 0.5, 2)
    color = np.ones((4, 4), np.float32)
    color[:, 3] = np.where(blocker.position[:, 0] > 0, 0.9, 0.1)
    film = Material("film", filter=Filter(blends=True, clear=0.5), stand_in=True)
    assert_the_left_half_is_a_hole(gl, (floor, replace(blocker, color=color)), (scenes.WHITE, film))
    light, camera = Light("directional", np.ones(3), np.zeros(3), DOWN), above(1.0)
    pane = replace(film, filter=Filter(transmission=0.9, clear=np.inf))
    lit = draw(gl, (floor, blocker), light, camera, (scenes.WHITE, pane))[0]
    np.testing.assert_array_equal(lit, draw(gl, (floor,), light, camera)[0])
    assert not np.array_equal(lit, draw(gl, (floor, blocker), light, camera, (scenes.WHITE, scenes.WHITE))[0])


def assert_the_left_half_is_a_hole(gl, meshes, materials, textures=()):
    light = Light("directional", np.ones(3), np.zeros(3), DOWN)
    camera = above(1.0)
    primary, normal, depth = draw(gl, meshes, light, camera, materials, textures)
    points = points_of(depth, camera)
    under = (np.abs(points[..., 1]) < 1e-3) & (normal[..., 1] > 0.9) & (np.abs(points[..., 2]) < 0.19)
    hole, solid = under & (np.abs(points[..., 0] + 0.1) < 0.09), under & (np.abs(points[..., 0] - 0.1) < 0.09)
    assert (primary[hole] > 0).all()
    assert not primary[solid].any()
