"""Frames with the `surface` operator."""

from dataclasses import replace

import numpy as np
import scenes

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene

SIZE = 96, 64
UP = -np.sqrt(0.5), 0, 0, np.sqrt(0.5)  # turns +Z to +Y
CAMERA = scenes.inside_camera()
BLEND = SurfaceBlend()
NAMES = "position", "rotation", "scale", "opacity", "sh", "slope"


def nothing(degree=0) -> Gaussians:
    shapes = (0, 3), (0, 4), (0, 3), (0,), (0, (degree + 1) ** 2, 3)
    return Gaussians(*(np.zeros(shape, np.float32) for shape in shapes))


def one(position=(0, 0, 0), scale=(0.3, 0.3, 0.03), opacity=1.0, rotation=UP, light=1.0):
    """A white Gaussian that faces +Y by default, as a floor does."""
    arrays = [position], [rotation], [scale], [opacity], np.full((1, 1, 3), light / 0.28209479)
    return Gaussians(*(np.array(a, np.float32) for a in arrays))


def draw(gl, fine, coarse=None, scene=None, camera=CAMERA, blend=BLEND, size=SIZE, splat_scale=1):
    """Draw a frame; return its indirect (H, W, 3), depth (H, W) and normal (H, W, 3)."""
    bake = Bake(fine, blend, coarse=nothing() if coarse is None else coarse)
    renderer = DeferredRenderer(gl, scene or Scene(tuple(scenes.box()), (scenes.WHITE,)), bake, *size, splat_scale)
    renderer.render(camera)
    layers = [renderer.read(layer) for layer in ("indirect", "depth", "normal")]
    renderer.release()
    return layers


def seen_points(depth, camera=CAMERA):
    """World-space positions (H, W, 3) of the pixels with a surface."""
    height, width = depth.shape
    p = camera.pinhole(width, height)
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    view = np.stack([(column - p.cx) / p.fx, (p.cy - row) / p.fy, -np.ones_like(row)], axis=-1) * depth[..., None]
    return view.astype(float) @ camera.world_from_view[:3, :3].T + camera.position


def surface_gaussians(scene, count, degree=0, seed=0) -> Gaussians:
    """Gaussians as a bake makes them: flat, on the surfaces, each with a colour of its own."""
    points = Triangles(scene).sample(count, seed)
    light = np.random.default_rng(seed).uniform(0, 1, (count, 3)).astype(np.float32)
    return from_surface(points.position, points.normal, light, degree)


def room() -> Scene:
    block = [replace(m, position=m.position - np.float32([0, 0.7, 0.4])) for m in scenes.box(0.3, inward=False)]
    return Scene((*scenes.box(), *block), (scenes.WHITE,))
