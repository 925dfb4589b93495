"""Remove what cannot be seen from a scene: holes, and materials and textures that no mesh uses."""

from dataclasses import replace

import numpy as np

from gsgi.runtime.scene import TEXTURE_SLOTS, Material, Scene, Texture, TextureSlot


def prune(scene: Scene) -> Scene:
    """The scene without fully cut-out meshes, cut-offs without effect, and then unused materials and textures.

    Bilinear filtering interpolates between texels, so the lowest and highest alpha of a texture bound its samples.
    """
    alphas = [_alpha(material, scene.textures) for material in scene.materials]
    bounds = [_with_color(alphas[mesh.material], mesh.color) for mesh in scene.meshes]
    cutoffs = [scene.materials[mesh.material].alpha_cutoff or 0.0 for mesh in scene.meshes]
    seen = [
        (mesh, low) for mesh, (low, high), cutoff in zip(scene.meshes, bounds, cutoffs, strict=True) if high >= cutoff
    ]
    lowest: dict[int, float] = {}
    for mesh, low in seen:
        lowest[mesh.material] = min(low, lowest.get(mesh.material, low))
    materials = [_uncut(scene.materials[index], lowest[index]) for index in sorted(lowest)]
    textures = sorted({slot.texture for material in materials for slot in material.slots()})
    material_of = {index: number for number, index in enumerate(sorted(lowest))}
    texture_of = {index: number for number, index in enumerate(textures)}
    return replace(
        scene,
        meshes=tuple(replace(mesh, material=material_of[mesh.material]) for mesh, _ in seen),
        materials=tuple(_renumbered(material, texture_of) for material in materials),
        textures=tuple(scene.textures[index] for index in textures),
    )


def _alpha(material: Material, textures: tuple[Texture, ...]) -> tuple[float, float]:
    """Lower and upper bound of a material's alpha; (1, 1) if it has no cut-off."""
    if material.alpha_cutoff is None:
        return 1.0, 1.0
    factor = material.base_color[3]
    if material.base_color_texture is None:
        return factor, factor
    alpha = textures[material.base_color_texture.texture].pixels[..., 3]
    return factor * float(alpha.min()) / 255, factor * float(alpha.max()) / 255


def _with_color(alpha: tuple[float, float], color: np.ndarray | None) -> tuple[float, float]:
    """The bounds `alpha` multiplied by those of the vertex colours of a mesh."""
    if color is None:
        return alpha
    return alpha[0] * float(color[:, 3].min()), alpha[1] * float(color[:, 3].max())


def _uncut(material: Material, lowest: float) -> Material:
    """The material without its cut-off if no alpha is below it."""
    if material.alpha_cutoff is None or lowest < material.alpha_cutoff:
        return material
    return replace(material, alpha_cutoff=None)


def _renumbered(material: Material, texture_of: dict[int, int]) -> Material:
    slots = {name: getattr(material, name) for name in TEXTURE_SLOTS}
    return replace(
        material,
        **{name: TextureSlot(texture_of[slot.texture], slot.uv) for name, slot in slots.items() if slot is not None},
    )
