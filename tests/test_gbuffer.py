"""G-buffer against what a ray through each pixel would meet."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.runtime.camera import look_at
from gsgi.runtime.renderer import DeferredRenderer
from gsgi.runtime.scene import Material, Mesh, Scene, Texture

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


def floor_of(material, textures=(), uv_scale=1.0):
    mesh = scenes.floor()
    return Scene(
        (Mesh(mesh.position, mesh.normal, mesh.uv * np.float32(uv_scale), mesh.triangle, 0),), (material,), textures
    )


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


@pytest.mark.parametrize("wrap", [("repeat", "clamp"), ("mirror", "repeat"), ("clamp", "mirror")])
def test_textures_are_decoded_then_filtered_then_wrapped(gl, wrap):
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 4), np.uint8)
    material = Material(
        base_color=(0.5, 1.0, 1.0, 1.0), base_color_texture=0, emission=(2.0, 2.0, 2.0), emission_texture=0
    )
    albedo, _, _, primary = draw(gl, floor_of(material, (Texture(pixels, wrap),), uv_scale=2.6))
    t = (np.arange(SIZE) + 0.5) / SIZE * 2.6
    expected = bilinear(srgb_to_linear(pixels[..., :3]), *np.broadcast_arrays(t[None, :], t[:, None]), wrap)
    # llvmpipe approximates the sRGB curve to 7e-4 and weighs texels in 8 bits.
    assert np.abs(albedo - expected * [0.5, 1, 1]).max() < 6e-3
    assert np.abs(primary - 2 * expected).max() < 12e-3


def test_a_mask_cuts_holes_at_its_cutoff(gl):
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, :, 3] = 100, 200
    material = Material(base_color_texture=0, alpha_cutoff=0.5)
    (depth,) = draw(gl, floor_of(material, (Texture(pixels, ("clamp", "clamp")),)), layers=("depth",))
    # alpha runs from 100 at u = 1/4 to 200 at u = 3/4
    u = (np.arange(SIZE) + 0.5) / SIZE
    assert np.array_equal(depth[7] > 0, u > 0.25 + 0.5 * (127.5 - 100) / 100)


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
