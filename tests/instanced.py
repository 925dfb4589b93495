"""Copies of a bent sheet, turned, mirrored and uneven, to trace and to draw."""

from dataclasses import replace

import numpy as np
import scenes
from scipy.spatial.transform import Rotation

from gsgi.runtime.instance import Instance, flat
from gsgi.runtime.scene import Environment, Filter, Light, Material, Mesh, Scene, Texture, TextureSlot

TURNED = Rotation.from_euler("xyz", (20, 130, -40), degrees=True).as_matrix()
PLACES = {
    "moved": np.eye(3),
    "turned": TURNED,
    "mirrored": np.diag([-1.0, 1, 1]),
    "mirrored and turned": TURNED @ np.diag([1.0, 1, -1]),
    "uneven": np.diag([0.5, 1.5, 1.0]),
    "uneven, mirrored and turned": TURNED @ np.diag([-0.7, 1.3, 1.0]) @ TURNED.T,
}
PICTURE = np.random.default_rng(3).integers(90, 255, (8, 8, 4), np.uint8)
TEXTURE = TextureSlot(0)
BUMPY = Material("bumpy", base_color_texture=TEXTURE, normal_texture=TextureSlot(1), normal_scale=0.5)
MATERIALS = {
    "opaque": BUMPY,
    "masked": replace(BUMPY, alpha_cutoff=0.6),
    "filter": replace(BUMPY, filter=Filter(blends=True), stand_in=True),
    "lamp": replace(BUMPY, emission=(1.0, 0.5, 0.2)),
}


def thing(material: int = 1) -> Mesh:
    """A bent sheet above a smaller one, with smooth normals, tangents, texture coordinates and colours."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.5, 0.5, 7), np.linspace(-0.4, 0.4, 7)))
    y = 0.3 * np.cos(3 * x) * np.cos(2 * z) + 0.5
    normal = np.stack(
        [0.9 * np.sin(3 * x) * np.cos(2 * z), np.ones_like(x), 0.6 * np.cos(3 * x) * np.sin(2 * z)], axis=1
    )
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.stack([normal[:, 1], -normal[:, 0], np.zeros_like(x)], axis=1)
    tangent = np.concatenate([along / np.linalg.norm(along, axis=1, keepdims=True), np.ones((49, 1))], axis=1)
    corner = np.add.outer(7 * np.arange(6), np.arange(6)).reshape(-1, 1)
    triangle = np.concatenate([corner + np.array(turn) for turn in ((0, 7, 1), (1, 7, 8))]).astype(np.uint32)
    uv = np.stack([x, z], axis=1)[:, None] * 2
    color = np.random.default_rng(5).uniform(0.6, 1, (49, 4))
    arrays = np.stack([x, y, z], axis=1), normal, uv, triangle, color, tangent
    position, normal, uv, triangle, color, tangent = (a.astype(np.float32) if a is not triangle else a for a in arrays)
    lower = position * np.float32([0.4, 0, 0.4]) + np.float32([0, 0.2, 0])
    upright = np.tile(np.float32([0, 1, 0]), (49, 1))
    return Mesh(
        np.concatenate([position, lower]), np.concatenate([normal, upright]), np.concatenate([uv, uv]),
        np.concatenate([triangle, triangle + np.uint32(49)]), material, np.concatenate([color, color]),
        np.concatenate([tangent, np.tile(np.float32([1, 0, 0, 1]), (49, 1))]),
    )  # fmt: skip


def placed(linear: np.ndarray, at: tuple[float, float, float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, at
    return matrix


def scene(material: Material, *matrices: np.ndarray, mesh: Mesh | None = None) -> Scene:
    """Copies of a mesh over a floor under a sun and a sky."""
    shape = mesh or thing()
    sun = Light("directional", np.full(3, 2.0), np.zeros(3), np.array([0.36, -0.8, 0.48]))
    copies = (Instance(shape, matrix, 1) for matrix in matrices)
    return Scene(
        (scenes.floor(4.0), *copies), (scenes.WHITE, replace(material, double_sided=True)),
        (Texture(PICTURE), Texture(PICTURE)), (sun,), Environment(np.full((1, 1, 3), 0.7, np.float32)),
    )  # fmt: skip


def flattened(of: Scene) -> Scene:
    return replace(of, meshes=tuple(flat(mesh) for mesh in of.meshes))
