"""A scene that gives every pass some work, and frames of it."""

from dataclasses import replace

import numpy as np
import oracle
import scenes

from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend
from gsgi.runtime.gl.renderer import LAYERS, DeferredRenderer
from gsgi.runtime.scene import Environment, Light, Material, Mesh, Scene, Texture, TextureSlot

WIDTH, HEIGHT = 96, 64


def full_scene() -> Scene:
    """A box with a masked, bumpy, textured block, a lamp, a sign, one light of each kind and a sky."""
    pixels = np.random.default_rng(0).integers(0, 256, (8, 8, 4), np.uint8)
    slot = TextureSlot(0)
    materials = (
        scenes.WHITE,
        Material("leaf", (1.0, 1.0, 1.0, 1.0), slot, 0.5, slot, slot, alpha_cutoff=0.3, double_sided=True),
        Material("lamp", emission=(2.0, 1.5, 1.0), emission_texture=slot),
        Material("sign", unlit=True),
    )
    block = [
        replace(m, position=m.position - np.float32([0, 0.7, 0.4]), material=1, tangent=tangent_of(m))
        for m in scenes.box(0.3, inward=False)
    ]
    lamp = scenes.quad([(-0.3, 0.3, -0.99), (0.3, 0.3, -0.99), (0.3, 0.6, -0.99), (-0.3, 0.6, -0.99)], 2)
    sign = replace(lamp, position=lamp.position - np.float32([0, 0.4, 0]), material=3, color=np.eye(4, dtype="f4"))
    down = np.array([0.1, -0.99, 0.1]) / np.linalg.norm([0.1, -0.99, 0.1])
    lights = (
        Light("point", np.array([1.0, 0.9, 0.8]), np.array([0.5, 0.6, 0.2]), down),
        Light("spot", np.array([2.0, 0.0, 3.0]), np.array([-0.6, 0.9, 0.3]), down, 4.0, 0.95, 0.7),
        Light("directional", np.array([0.2, 0.3, 0.4]), np.zeros(3), down),
    )
    walls = [wall for wall in scenes.box() if wall.normal[0, :2].min() > -0.5]  # no ceiling, no right wall
    sky = Environment(np.random.default_rng(1).random((8, 16, 3), np.float32), 0.5)
    return Scene((*walls, *block, lamp, sign), materials, (Texture(pixels, ("mirror", "repeat")),), lights, sky)


def tangent_of(mesh: Mesh) -> np.ndarray:
    """Tangents (4, 4) of a quad, along its first edge."""
    edge = mesh.position[1] - mesh.position[0]
    return np.tile(np.float32([*edge / np.linalg.norm(edge), 1]), (4, 1))


def bake() -> Bake:
    return Bake(oracle.random_gaussians(500, 2, seed=1), OverBlend(near=0.1))


def surface_bake() -> Bake:
    blend = SurfaceBlend(floor=0.05)  # with more, hardly a Gaussian of so few would show
    return Bake(oracle.random_gaussians(500, 0, 1), blend, coarse=oracle.random_gaussians(50, 2, 2))


def render(ctx, scene, baked, exposure=1.0, splat_scale=1) -> dict[str, np.ndarray]:
    renderer = DeferredRenderer(ctx, scene, baked, WIDTH, HEIGHT, splat_scale)
    renderer.render(scenes.inside_camera())
    layers = {layer: renderer.read(layer) for layer in LAYERS} | {"display": renderer.display(exposure)}
    renderer.release()
    return layers
