"""How metals reflect: as rough ones do on average, or not at all.

A metal of glTF has a specular lobe alone, and its base colour is the reflectance at normal incidence (glTF 2.0, B.2).
Here it reflects that share of the light diffusely; docs/how-it-works.md says how far that is from the lobe's average.
"""

from dataclasses import replace

import numpy as np

from .scene import Material, Scene

METALLIC = 0.5  # a surface counts as metal from this value on


def lambertian(scene: Scene) -> Scene:
    """The scene whose albedos are base colour * (1 - metallic) for the choice `scene.metals`.

    Where metals are rough, nothing is metallic any more. Where they are black, what is metal throughout has no textures
    that only its reflection would show.
    """
    if scene.metals == "rough":
        return replace(scene, materials=tuple(_rough(material) for material in scene.materials))
    blends = {mesh.material for mesh in scene.blended}
    return replace(scene, materials=tuple(_black(m, index in blends) for index, m in enumerate(scene.materials)))


def has_metal(scene: Scene) -> bool:
    """Whether `scene.metals` matters: some surface is metallic, however little, and its base colour is not black."""
    return any(
        material.metallic * _blue(material, scene).max() > 0
        for material in scene.used_materials()
        if any(material.base_color[:3])
    )


def metal_areas(scene: Scene) -> tuple[np.ndarray, float]:
    """The area (M,) of each material's surface that is metal, and the area of all surfaces, m^2.

    A texture is judged by all its texels. What is black has no part that counts as metal.
    """
    areas = np.zeros(len(scene.materials))
    for mesh in scene.meshes:
        areas[mesh.material] += mesh.areas().sum()
    shares = [
        (material.metallic * _blue(material, scene) > METALLIC).mean() if any(material.base_color[:3]) else 0.0
        for material in scene.materials
    ]
    return areas * shares, float(areas.sum())


def _rough(material: Material) -> Material:
    return replace(material, metallic=0.0, metallic_texture=None)


def _black(material: Material, blends: bool) -> Material:
    if material.metallic < 1 or material.metallic_texture is not None:
        return material
    base = material.base_color_texture if blends or material.alpha_cutoff is not None or material.filter else None
    return replace(material, base_color_texture=base, normal_texture=None)


def _blue(material: Material, scene: Scene) -> np.ndarray:
    """The factors (N,) of a material's metallic value: the blue texels of its texture, or 1."""
    if material.metallic_texture is None:
        return np.ones(1)
    return scene.textures[material.metallic_texture.texture].pixels[..., 2].reshape(-1) / 255
