"""pyrender materials as uniforms and defines of glsl/pyrender/forward.frag."""

from collections.abc import Iterator

import moderngl
import numpy as np

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gl.permutations import Primitive

from .dimming import Dimming
from .uploads import Uploads

# Samplers of forward.frag and their fields of a MetallicRoughnessMaterial, in the order of texture units.
SLOTS = {
    "base": "baseColorTexture",
    "surface": "metallicRoughnessTexture",
    "occlusion": "occlusionTexture",
    "emission": "emissiveTexture",
    "normal": "normalTexture",
}


def textures(primitive) -> Iterator:
    """The textures that a primitive shows."""
    for name in SLOTS:
        if (texture := texture_of(primitive, name)) is not None:
            yield texture


def texture_of(primitive, slot: str):
    """Texture in a slot of `SLOTS`, or None if there is none that can be used.

    It needs an image and texture coordinates; a normal map also needs normals.
    """
    texture = getattr(primitive.material, SLOTS[slot])
    usable = primitive.texcoord_0 is not None and (slot != "normal" or primitive.normals is not None)
    return texture if texture is not None and texture.source is not None and usable else None


def check(primitive) -> None:
    """Raise UnsupportedError for a material that is not metallic-roughness."""
    if not hasattr(primitive.material, "baseColorFactor"):
        kind = type(primitive.material).__name__
        raise UnsupportedError(f"{kind}: pyrender leaves its colour undefined; use MetallicRoughnessMaterial")


def look(primitive, **light) -> Primitive:
    """Description that determines the defines of the primitive's shader under this light."""
    slots = [name for name in SLOTS if texture_of(primitive, name) is not None]
    return Primitive(slots, primitive.normals is not None, primitive.color_0 is not None, **light)


def bind(primitive, uploads: Uploads, white: moderngl.Texture, dimming: Dimming) -> dict:
    """Bind a texture for each slot to units 0 to 4, `white` for empty slots; return the material's uniforms."""
    material = primitive.material
    factor = dimming.factor([material.name] if material.name else [])
    uniforms = {
        "base_color": material.baseColorFactor,
        "metallic": material.metallicFactor,
        "roughness": material.roughnessFactor,
        "emission": np.multiply(material.emissiveFactor, np.sqrt(factor)),  # the shader applies it twice
    }
    for unit, name in enumerate(SLOTS):
        texture = texture_of(primitive, name)
        (white if texture is None else uploads[texture].texture).use(unit)
        mirror = (0.0, 0.0) if texture is None else uploads[texture].mirror
        uniforms |= {f"{name}_texture": unit, f"{name}_mirror": mirror}
    return uniforms
