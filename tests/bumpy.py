"""A room whose walls have a normal map."""

from dataclasses import replace

import numpy as np
import scenes
from frames import tangent_of

from gsgi.runtime.scene import Light, Material, Scene, Texture, TextureSlot

WAVES = 3  # of the normal map, along each edge of a wall


def bumpy_room(scale: float = 1.0) -> Scene:
    """A closed box with walls of several colours, bent by up to 40 degrees, and a lamp that shines at one of them.

    `scale` is that of the normal map.
    """
    edge = 64
    x, y = np.meshgrid(*[(np.arange(edge) + 0.5) / edge * 2 * np.pi * WAVES] * 2)
    bent = np.stack([0.6 * np.sin(x), 0.6 * np.sin(y), np.ones_like(x)], axis=2)
    bent /= np.linalg.norm(bent, axis=2, keepdims=True)
    texels = np.concatenate([np.rint((bent + 1) / 2 * 255), np.full((edge, edge, 1), 255)], axis=2).astype(np.uint8)
    colours = {"white": (0.8, 0.8, 0.8), "red": (0.8, 0.1, 0.1), "green": (0.1, 0.7, 0.1)}
    materials = tuple(
        Material(name, (*colour, 1.0), normal_texture=TextureSlot(0), normal_scale=scale)
        for name, colour in colours.items()
    )
    walls = [
        replace(wall, tangent=tangent_of(wall), material=(1, 2, 0, 0, 0, 0)[i]) for i, wall in enumerate(scenes.box())
    ]
    down = np.array([0.4, -0.9, 0.2]) / np.linalg.norm([0.4, -0.9, 0.2])
    lamp = Light("spot", np.array([12.0, 11.0, 9.0]), np.array([-0.2, 0.7, -0.1]), down, cos_inner=0.9, cos_outer=0.6)
    cameras = {"inside": scenes.inside_camera()}
    return Scene(tuple(walls), materials, (Texture(texels),), lights=(lamp,), cameras=cameras)
