"""Remove what cannot be seen from a scene: holes, and materials and textures that no mesh uses."""

import math
from dataclasses import replace

import numpy as np

from gsgi.runtime.constants import ALPHA_MIN
from gsgi.runtime.scene import TEXTURE_SLOTS, Material, Mesh, Scene, Texture, TextureSlot

from .transparency import clear_below


def prune(scene: Scene) -> Scene:
    """The scene without fully cut-out meshes, cut-offs without effect, and then unused materials and textures.

    Bilinear filtering interpolates between texels, so the lowest and highest alpha of a texture bound its samples.
    """
    blends = {mesh.material for mesh in scene.blended}
    alphas = [_alpha(material, scene.textures, i in blends) for i, material in enumerate(scene.materials)]
    bounds: dict[int, tuple[float, float]] = {}
    tinted = {mesh.material for mesh in scene.meshes if mesh.color is not None and mesh.color[:, :3].min() < 1}

    def seen(mesh: Mesh) -> bool:
        if mesh.color is None and _is_clear(scene.materials[mesh.material]):
            return False
        low, high = _with_color(alphas[mesh.material], mesh.color)
        least = ALPHA_MIN if mesh.material in blends and not scene.materials[mesh.material].tint else 0.0
        is_seen = high >= max(least, scene.materials[mesh.material].alpha_cutoff or 0.0)
        if is_seen:
            lowest, highest = bounds.get(mesh.material, (low, high))
            bounds[mesh.material] = min(low, lowest), max(high, highest)
        return is_seen

    meshes, blended = ([mesh for mesh in part if seen(mesh)] for part in (scene.meshes, scene.blended))
    materials = [
        _uncut(_tinted(scene.materials[index]) if index in tinted else scene.materials[index], *bounds[index])
        for index in sorted(bounds)
    ]
    textures = sorted({slot.texture for material in materials for slot in material.slots()})
    material_of = {index: number for number, index in enumerate(sorted(bounds))}
    texture_of = {index: number for number, index in enumerate(textures)}
    return replace(
        scene,
        meshes=tuple(replace(mesh, material=material_of[mesh.material]) for mesh in meshes),
        blended=tuple(replace(mesh, material=material_of[mesh.material]) for mesh in blended),
        materials=tuple(_renumbered(material, texture_of) for material in materials),
        textures=tuple(scene.textures[index] for index in textures),
    )


def _alpha(material: Material, textures: tuple[Texture, ...], blends: bool) -> tuple[float, float]:
    """Lower and upper bound of a material's alpha; (1, 1) if it neither blends nor has a cut-off."""
    if material.alpha_cutoff is None and not blends and material.filter is None:
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


def _is_clear(material: Material) -> bool:
    """Whether all light passes the material as it came."""
    of = material.filter
    is_glass = of.transmission == 1 and not of.blends if of else material.tint == 1 and material.base_color[3] == 0
    return is_glass and material.base_color_texture is None and min(material.base_color[:3]) == 1


def _tinted(material: Material) -> Material:
    """The material where vertex colours tint it, by who knows how much: it is clear where it is open alone."""
    of = material.filter
    return replace(material, filter=replace(of, clear=clear_below(of, 0.0))) if of and of.clear else material


def _uncut(material: Material, lowest: float, highest: float) -> Material:
    """The material without its cut-off if no alpha is below it; clear everywhere or nowhere where all alphas are."""
    if material.alpha_cutoff is not None and lowest >= material.alpha_cutoff:
        material = replace(material, alpha_cutoff=None)
    if material.filter is None or lowest < material.filter.clear <= highest:
        return material
    clear = math.inf if highest < material.filter.clear else 0.0
    return replace(material, filter=replace(material.filter, clear=clear))


def _renumbered(material: Material, texture_of: dict[int, int]) -> Material:
    slots = {name: getattr(material, name) for name in TEXTURE_SLOTS}
    return replace(
        material,
        **{name: TextureSlot(texture_of[slot.texture], slot.uv) for name, slot in slots.items() if slot is not None},
    )
