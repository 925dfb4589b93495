"""G-buffer against what a ray through each pixel would meet."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.renderer import DeferredRenderer, _decode_octahedral
from gsgi.runtime.scene import Light, Material, Scene, Texture, TextureSlot

SIZE = 32
# Seen from above, pixel by pixel: a floor of edge 2 fills the image exactly.
ABOVE = look_at(np.array([0.0, 1.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, -1.0]), np.pi / 2, 0.01)
BELOW = look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, -1.0]), np.pi / 2, 0.01)


def draw(gl, scene, camera=ABOVE, layers=("albedo", "normal", "depth", "primary")):
    renderer = DeferredRenderer(gl, scene, None, SIZE, SIZE)
    renderer.render(camera)
    result = [renderer.read(layer) for layer in layers]
    renderer.release()
    return result


def floor_of(material, textures=(), uv_scale=1.0, **attributes):
    """A floor of edge 2. Metals are black, so that all textures of a material count."""
    mesh = scenes.floor()
    mesh = replace(mesh, **{"uv": mesh.uv * np.float32(uv_scale), **attributes})
    return Scene((mesh,), (material,), textures, metals="black")


def per_vertex(*value):
    return np.tile(np.float32(value), (4, 1))


def random_pixels(seed=0):
    return np.random.default_rng(seed).integers(0, 256, (5, 7, 4), np.uint8)


def test_a_floor_seen_from_above(gl):
    material = Material(base_color=(0.8, 0.4, 0.2, 1.0), metallic=0.25, emission=(1.0, 2.0, 30.0))
    albedo, normal, depth, primary = draw(gl, floor_of(material))
    assert albedo.shape == (SIZE, SIZE, 3)
    assert depth.shape == (SIZE, SIZE)
    assert np.allclose(albedo, [0.6, 0.3, 0.15], rtol=1e-3)
    assert np.array_equal(normal, np.broadcast_to(np.float32([0, 1, 0]), normal.shape))
    assert np.allclose(depth, 1, atol=1e-6)
    assert np.allclose(primary, [1, 2, 30], rtol=1e-3)


def test_depth_and_normals_inside_a_box(gl):
    scene, camera = scenes.furnace(), scenes.inside_camera()
    normal, depth = draw(gl, scene, camera, ("normal", "depth"))
    pinhole = camera.pinhole(SIZE, SIZE)
    x = (np.arange(SIZE) + 0.5 - pinhole.cx) / pinhole.fx
    ray = np.stack(np.broadcast_arrays(x[None, :], -x[:, None], -1.0), axis=-1) @ camera.world_from_view[:3, :3].T
    distance = (np.sign(ray) - camera.position) / ray
    assert np.allclose(depth, distance.min(axis=-1), rtol=1e-5)
    wall = np.eye(3)[distance.argmin(axis=-1)] * -np.sign(ray)
    clear = np.abs(np.sort(distance, axis=-1)[..., 1] - depth) > 1e-3
    assert np.allclose(normal[clear], wall[clear], atol=1e-6)


def test_nothing_in_view_is_zero(gl):
    away = look_at(np.array([0.0, 1.0, 0.0]), np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.0, -1.0]), 1.0, 0.01)
    for layer in draw(gl, floor_of(scenes.WHITE), away):
        assert not layer.any()


def test_a_single_sided_surface_is_not_there_from_behind(gl):
    lamp = replace(scenes.WHITE, emission=(1.0, 1.0, 1.0))
    albedo, _, depth, primary = draw(gl, floor_of(lamp), BELOW)
    assert not albedo.any()
    assert not depth.any()
    assert not primary.any()


def test_a_double_sided_surface_faces_the_camera(gl):
    lamp = replace(scenes.WHITE, emission=(1.0, 1.0, 1.0), double_sided=True)
    _, normal, depth, primary = draw(gl, floor_of(lamp), BELOW)
    assert (normal == [0, -1, 0]).all()
    assert np.allclose(depth, 1, atol=1e-6)
    assert (primary == 1).all()


def srgb_to_linear(value):
    value = np.asarray(value, float) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def bilinear(linear, u, v, wrap):
    """Oracle: texture value at (u, v), addressed one axis at a time."""

    def axis(coordinate, size, mode):
        x = coordinate * size - 0.5
        first = np.floor(x).astype(int)
        pair = np.stack([first, first + 1])
        if mode == "repeat":
            pair = pair % size
        elif mode == "mirror":
            pair = np.minimum(pair % (2 * size), 2 * size - 1 - pair % (2 * size))
        return np.clip(pair, 0, size - 1), x - first

    (x0, x1), fx = axis(u, linear.shape[1], wrap[0])
    (y0, y1), fy = axis(v, linear.shape[0], wrap[1])
    fx, fy = fx[..., None], fy[..., None]
    return (linear[y0, x0] * (1 - fx) + linear[y0, x1] * fx) * (1 - fy) + (
        linear[y1, x0] * (1 - fx) + linear[y1, x1] * fx) * fy  # fmt: skip


def grid(scale=1.0):
    """Texture coordinates (u, v) of the pixels of a floor seen from above."""
    t = (np.arange(SIZE) + 0.5) / SIZE * scale
    return np.broadcast_arrays(t[None, :], t[:, None])


@pytest.mark.parametrize("wrap", [("repeat", "clamp"), ("mirror", "repeat"), ("clamp", "mirror")])
def test_textures_are_decoded_then_filtered_then_wrapped(gl, wrap):
    pixels, slot = random_pixels(), TextureSlot(0)
    material = Material(
        base_color=(0.5, 1.0, 1.0, 1.0), base_color_texture=slot, emission=(2.0, 2.0, 2.0), emission_texture=slot
    )
    albedo, _, _, primary = draw(gl, floor_of(material, (Texture(pixels, wrap),), uv_scale=2.6))
    expected = bilinear(srgb_to_linear(pixels[..., :3]), *grid(2.6), wrap)
    # llvmpipe approximates the sRGB curve to 7e-4 and weighs texels in 8 bits.
    assert np.abs(albedo - expected * [0.5, 1, 1]).max() < 6e-3
    assert np.abs(primary - 2 * expected).max() < 12e-3


def test_a_texture_may_be_nearest(gl):
    pixels = random_pixels()
    material = Material(base_color_texture=TextureSlot(0))
    albedo, *_ = draw(gl, floor_of(material, (Texture(pixels, nearest=True),)))
    u, v = grid()
    expected = srgb_to_linear(pixels[(v * 5).astype(int), (u * 7).astype(int), :3])
    assert np.abs(albedo - expected).max() < 2e-3


def test_metallic_is_the_blue_of_a_linear_texture(gl):
    pixels, wrap = random_pixels(), ("repeat", "repeat")
    material = Material(base_color=(0.8, 0.4, 0.2, 1.0), metallic=0.5, metallic_texture=TextureSlot(0))
    albedo, *_ = draw(gl, floor_of(material, (Texture(pixels),)))
    metallic = 0.5 * bilinear(pixels[..., 2:3] / 255, *grid(), wrap)
    assert np.abs(albedo - [0.8, 0.4, 0.2] * (1 - metallic)).max() < 3e-3
    albedo, *_ = draw(gl, replace(floor_of(material, (Texture(pixels),)), metals="rough"))
    assert np.allclose(albedo, [0.8, 0.4, 0.2], rtol=1e-3)


def test_one_image_may_be_srgb_in_one_slot_and_linear_in_another(gl):
    grey = np.full((1, 1, 4), 128, np.uint8)
    slot = TextureSlot(0)
    material = Material(base_color_texture=slot, metallic=1.0, metallic_texture=slot)
    albedo, *_ = draw(gl, floor_of(material, (Texture(grey),)))
    assert np.allclose(albedo, srgb_to_linear(128) * (1 - 128 / 255), atol=1e-3)


def test_each_slot_reads_its_own_uv_channel(gl):
    ramp = np.zeros((1, 2, 4), np.uint8)
    ramp[0, 1] = 255
    u, v = scenes.floor().uv[:, 0].T
    uv = np.stack([np.stack([v, v], axis=1), np.full((4, 2), 0.3), np.stack([u, u], axis=1)], axis=1)
    material = Material(
        metallic=1.0, metallic_texture=TextureSlot(0, 2), emission=(1.0, 1.0, 1.0), emission_texture=TextureSlot(0, 0)
    )
    albedo, _, _, primary = draw(gl, floor_of(material, (Texture(ramp, nearest=True),), uv=uv.astype(np.float32)))
    u, v = grid()
    assert np.array_equal(albedo[..., 0], u < 0.5)
    assert np.array_equal(primary[..., 0], v > 0.5)


def test_vertex_colors_are_interpolated_and_multiply(gl):
    u, v = scenes.floor().uv[:, 0].T
    color = np.stack([u, v, 0 * u + 0.5, 0 * u + 1], axis=1)
    scene = floor_of(Material(base_color=(0.5, 1.0, 1.0, 1.0)), color=color)
    albedo, *_ = draw(gl, scene)
    u, v = grid()
    assert np.abs(albedo - np.stack([0.5 * u, v, 0 * u + 0.5], axis=-1)).max() < 1e-3


def test_a_mesh_without_colors_is_white_beside_one_with_them(gl):
    half = [(-1, 0, 1), (0, 0, 1), (0, 0, -1), (-1, 0, -1)]
    left = replace(scenes.quad(half), color=per_vertex(0.25, 1, 1, 1))
    right = scenes.quad(np.add(half, [1, 0, 0]))
    albedo, *_ = draw(gl, Scene((right, left), (scenes.WHITE,)))
    assert np.allclose(albedo[:, : SIZE // 2], [0.125, 0.5, 0.5], rtol=1e-3)
    assert np.allclose(albedo[:, SIZE // 2 :], 0.5, rtol=1e-3)


def test_an_unlit_surface_shows_its_base_color(gl):
    white = Texture(np.full((1, 1, 4), 255, np.uint8))
    slot = TextureSlot(0)
    material = Material("", (0.8, 0.4, 0.2, 1.0), slot, 0.5, slot, slot, 1.0, (9.0, 9.0, 9.0), slot, unlit=True)
    sun = Light("directional", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    scene = replace(floor_of(material, (white,), color=per_vertex(1, 1, 0.5, 1)), lights=(sun,))
    albedo, normal, depth, primary = draw(gl, scene)
    assert not albedo.any()
    assert (normal == [0, 1, 0]).all()
    assert (depth > 0).all()
    assert np.allclose(primary, [0.8, 0.4, 0.1], rtol=1e-3)


def normal_mapped(gl, pixels, tangent, scale=1.0, camera=ABOVE, double_sided=False):
    """Layer "normal" of a floor with this normal texture (not filtered) and tangent (4,)."""
    material = Material(normal_texture=TextureSlot(0), normal_scale=scale, double_sided=double_sided)
    texture = Texture(np.asarray(pixels, np.uint8), nearest=True)
    return draw(gl, floor_of(material, (texture,), tangent=per_vertex(*tangent)), camera, ("normal",))[0]


def one_texel(*xyz):
    return np.uint8([[[*xyz, 255]]])


def test_a_flat_normal_map_changes_nothing_but_by_its_quantisation(gl):
    normal = normal_mapped(gl, one_texel(128, 128, 255), (1, 0, 0, 1))
    assert np.abs(normal - [0, 1, 0]).max() < 1.5 / 255
    assert np.array_equal(normal_mapped(gl, one_texel(128, 128, 255), (1, 0, 0, 1), scale=0.0)[0, 0], [0, 1, 0])


@pytest.mark.parametrize("w", [1, -1])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_each_texel_tilts_the_normal(gl, w, scale):
    pixels = random_pixels()
    pixels[..., 2] |= 128
    tangent = np.array([0.6, 0, 0.8])
    normal = normal_mapped(gl, pixels, (*tangent, w), scale)
    u, v = grid()
    m = (pixels[(v * 5).astype(int), (u * 7).astype(int), :3] / 255 * 2 - 1) * [scale, scale, 1]
    expected = m @ np.stack([tangent, w * np.cross([0, 1, 0], tangent), [0, 1, 0]])
    assert np.abs(normal - expected / np.linalg.norm(expected, axis=-1, keepdims=True)).max() < 2e-3


def test_the_tangent_is_made_orthogonal_to_the_normal(gl):
    texel = one_texel(200, 90, 220)
    tilted = normal_mapped(gl, texel, (0.6, 0.8, 0, -1))
    assert np.abs(tilted - normal_mapped(gl, texel, (1, 0, 0, -1))).max() < 1e-3


def test_from_behind_the_mapped_normal_is_reversed(gl):
    texel, tangent = one_texel(220, 100, 200), (1, 0, 0, 1)
    front = normal_mapped(gl, texel, tangent)[0, 0]
    behind = normal_mapped(gl, texel, tangent, camera=BELOW, double_sided=True)[0, 0]
    assert np.abs(behind + front).max() < 3e-3


def test_a_mapped_normal_below_the_triangle_takes_light_from_above_alone(gl):
    material = Material(normal_texture=TextureSlot(0))
    below = Texture(one_texel(255, 128, 0))  # tangent space (1, 0, -1)
    from_right, from_below = np.array([2.0, 1.0, 0.0]), np.array([1.0, -1.0, 0.0])
    for wi, cosine in ((from_right, 1 / np.sqrt(10)), (from_below, 0.0)):
        sun = Light("directional", np.ones(3), np.zeros(3), -wi / np.linalg.norm(wi))
        scene = replace(floor_of(material, (below,), tangent=per_vertex(1, 0, 0, 1)), lights=(sun,))
        _, normal, _, primary = draw(gl, scene)
        assert np.abs(normal - np.array([1, -1, 0]) / np.sqrt(2)).max() < 5e-3
        assert np.abs(primary - cosine / np.pi).max() < 2e-3


@pytest.mark.parametrize("tangent", [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 0, 1)])
def test_no_normal_map_makes_a_normal_that_is_not_unit(gl, tangent):
    # Filtering takes the vector through zero.
    pixels = np.uint8([[[127, 127, 127, 255], [128, 128, 128, 255]]])
    material = Material(normal_texture=TextureSlot(0))
    scene = floor_of(material, (Texture(pixels),), tangent=per_vertex(*tangent))
    (normal,) = draw(gl, scene, layers=("normal",))
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-3)
    if tangent[0] == 0:
        assert (normal == [0, 1, 0]).all()


def test_a_vertex_normal_of_length_zero_is_not_nan(gl):
    (normal,) = draw(gl, floor_of(scenes.WHITE, normal=per_vertex(0, 0, 0)), layers=("normal",))
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-3)
    assert (normal[..., 1] > 0).all()


def test_the_triangles_normal_and_the_interpolated_one_stand_side_by_side(gl):
    tilted = np.float32([0.6, 0.8, 0])
    renderer = DeferredRenderer(gl, floor_of(scenes.WHITE, normal=per_vertex(*tilted)), None, SIZE, SIZE)
    renderer.render(ABOVE)
    stored = np.frombuffer(renderer.gbuffer.normal.read(), np.float16).reshape(SIZE, SIZE, 4).astype(np.float32)
    renderer.release()
    assert np.abs(_decode_octahedral(stored[..., :2]) - tilted).max() < 1e-3
    assert np.abs(_decode_octahedral(stored[..., 2:]) - [0, 1, 0]).max() < 1e-3


def test_a_mask_cuts_holes_at_its_cutoff(gl):
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, :, 3] = 100, 200
    material = Material(base_color_texture=TextureSlot(0), alpha_cutoff=0.5)
    (depth,) = draw(gl, floor_of(material, (Texture(pixels, ("clamp", "clamp")),)), layers=("depth",))
    # alpha runs from 100 at u = 1/4 to 200 at u = 3/4
    u = (np.arange(SIZE) + 0.5) / SIZE
    assert np.array_equal(depth[7] > 0, u > 0.25 + 0.5 * (127.5 - 100) / 100)


def test_the_alpha_of_factor_texture_and_vertex_color_multiply(gl):
    half = Texture(np.full((1, 1, 4), 128, np.uint8))
    u = scenes.floor().uv[:, 0, :1]
    color = np.concatenate([np.ones((4, 3)), u], axis=1)
    material = Material(base_color=(1, 1, 1, 0.5), base_color_texture=TextureSlot(0), alpha_cutoff=0.1)
    (depth,) = draw(gl, floor_of(material, (half,), color=color), layers=("depth",))
    assert np.array_equal(depth[0] > 0, 0.5 * 128 / 255 * grid()[0][0] >= 0.1)


def test_row_zero_is_the_top(gl):
    quad = scenes.quad([(-1, 0, -0.5), (1, 0, -0.5), (1, 0, -1), (-1, 0, -1)])
    (depth,) = draw(gl, Scene((quad,), (scenes.WHITE,)), layers=("depth",))
    assert (depth[: SIZE // 4] > 0).all()
    assert not depth[SIZE // 4 :].any()


def test_a_normal_against_the_winding_is_turned_to_the_camera(gl):
    floor = scenes.floor(5.0)
    scene = Scene((replace(floor, normal=-floor.normal),), (scenes.WHITE,))
    renderer = DeferredRenderer(gl, scene, None, 8, 8)
    renderer.render(scenes.above_camera())
    np.testing.assert_allclose(renderer.read("normal")[4, 4], [0, 1, 0], atol=1e-3)
    renderer.release()
