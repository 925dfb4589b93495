"""What the path tracer knows of a surface, against the G-buffer: two implementations of one record."""

from dataclasses import replace

import numpy as np
import pytest

from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Light, Material, Mesh, Scene, Texture, TextureSlot

SIZE = 96
LIGHT = Light("directional", np.array([3.0, 2.5, 2.0]), np.zeros(3), np.array([0.3, -0.8, -0.4]) / np.sqrt(0.89))


def noise(seed: int, low: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(low, 256, (6, 5, 4), np.uint8)


def patch(material: int, column: int, row: int, mirrored: bool = False) -> Mesh:
    """A slightly bent square of the wall in the plane z = 0, with everything that a mesh can have."""
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    position = np.concatenate([corner * 0.9 + [column, row], np.zeros((4, 1))], axis=1).astype(np.float32)
    normal = np.concatenate([corner - 0.5, np.ones((4, 1))], axis=1)
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    uv = np.stack([corner * 1.7 - 0.3, corner[:, ::-1] * 2.3], axis=1)
    color = np.array([[1, 1, 1, 1], [0.2, 1, 0.5, 1], [1, 0.3, 1, 0.2], [0.6, 0.6, 0.1, 0.8]], np.float32)
    tangent = np.tile(np.float32([1, 0, 0, -1 if mirrored else 1]), (4, 1))
    triangle = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    return Mesh(position, normal, uv, triangle, material, color, tangent)


def wall() -> Scene:
    """Six patches: plain, textured, metal, masked, normal-mapped, unlit; each texture with a wrap mode of its own."""
    textures = (
        Texture(noise(1, 60), ("mirror", "clamp")),
        Texture(noise(2), ("repeat", "mirror")),
        Texture(noise(3), ("clamp", "repeat"), nearest=True),
        Texture(np.clip(noise(4).astype(int) // 3 + [80, 80, 170, 0], 0, 255).astype(np.uint8)),
    )
    base = {"base_color_texture": TextureSlot(0), "base_color": (0.9, 0.8, 0.7, 0.9)}
    materials = (
        Material("plain", (0.8, 0.5, 0.3, 1.0)),
        Material("lamp", **base, emission=(2.0, 1.0, 0.5), emission_texture=TextureSlot(2, 1)),
        Material("metal", **base, metallic=0.8, metallic_texture=TextureSlot(1, 1)),
        Material("leaf", **base, alpha_cutoff=0.4, double_sided=True),
        Material("bumpy", normal_texture=TextureSlot(3, 1), normal_scale=0.7),
        Material("sign", **base, unlit=True),
    )
    meshes = tuple(patch(k, k % 3, k // 3, mirrored=k == 4) for k in range(6))
    camera = look_at(np.array([1.6, 1.1, 3.2]), np.array([1.45, 0.95, 0.0]), np.array([0.0, 1.0, 0.0]), 0.75, 0.01)
    return Scene(meshes, materials, textures, (LIGHT,), cameras={"front": camera})


def layers(gl, scene: Scene) -> tuple[dict, dict]:
    """What its camera sees, as GL draws it and as the path tracer finds it."""
    camera = scene.cameras["front"]
    renderer = DeferredRenderer(gl, scene, None, SIZE, SIZE)
    renderer.render(camera)
    drawn = {layer: renderer.read(layer) for layer in ("albedo", "normal", "depth", "primary")}
    renderer.release()
    tracer = Tracer(scene)
    surface = tracer.surface(camera, SIZE, SIZE)
    primary = surface.emission + surface.albedo * surface.image(tracer.direct(*surface.shading_points()))
    traced = {"albedo": surface.albedo, "normal": surface.shading_normal, "depth": surface.depth, "primary": primary}
    return drawn, traced


@pytest.fixture(scope="module", params=["rough", "black"])
def both(gl, request):
    """The layers of the wall, with metals that reflect, and that do not."""
    return layers(gl, replace(wall(), metals=request.param))


def inner(drawn: dict, traced: dict) -> np.ndarray:
    """Pixels (H, W) where both see a surface: edges of holes and patches fall either way."""
    return (drawn["depth"] > 0) & (traced["depth"] > 0)


def test_both_see_the_same_surfaces_and_holes(both):
    drawn, traced = both
    differ = (drawn["depth"] > 0) != (traced["depth"] > 0)
    assert differ.mean() < 2e-3
    leaf = traced["depth"][: SIZE // 2, : SIZE // 3] > 0
    assert leaf.any()
    assert not leaf.all()


@pytest.mark.parametrize(("layer", "tolerance"), [("albedo", 2e-3), ("normal", 8e-3), ("primary", 6e-3)])
def test_layers_are_equal(both, layer, tolerance):
    drawn, traced = both
    difference = np.abs(drawn[layer] - traced[layer])[inner(drawn, traced)]
    # llvmpipe filters 8-bit texels with 8-bit weights: a step of 1/255 of a normal texel tilts the normal by 2/255.
    assert np.quantile(difference, 0.99) < tolerance
    assert difference.mean() < tolerance / 4


def test_an_unlit_surface_has_no_albedo(both):
    _, traced = both
    sign = traced["albedo"][: SIZE // 2 - 4, SIZE // 3 * 2 + 6 :]
    assert sign.max() == 0
    assert traced["primary"][: SIZE // 2 - 4, SIZE // 3 * 2 + 6 :].max() > 0.1


@pytest.mark.parametrize("double_sided", [False, True])
def test_normals_against_the_winding_bend_the_same_way(gl, double_sided):
    scene = wall()
    bumpy = replace(scene.materials[4], double_sided=double_sided)
    inverted = [replace(patch(4, k, 0, mirrored=k == 1), normal=-patch(4, k, 0).normal) for k in (0, 1)]
    behind = patch(4, 2, 0)
    behind = replace(behind, triangle=behind.triangle[:, ::-1].copy())
    materials = (*scene.materials[:4], bumpy, *scene.materials[5:])
    drawn, traced = layers(gl, replace(scene, meshes=(*inverted, behind), materials=materials))
    both_see = inner(drawn, traced)
    assert both_see.any()
    assert np.quantile(np.abs(drawn["normal"] - traced["normal"])[both_see], 0.99) < 8e-3
