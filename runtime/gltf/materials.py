"""Read the materials of a glTF file, each once and only when it is used."""

from dataclasses import dataclass

from gsgi.runtime.scene import MAX_LIGHT, Material, TextureSlot

from . import transparency
from .document import Document
from .json_value import Json
from .problems import Code
from .textures import Textures, UvChannel

EMISSIVE_STRENGTH, UNLIT = "KHR_materials_emissive_strength", "KHR_materials_unlit"
SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"


@dataclass(frozen=True)
class Paint:
    """A material as primitives use it: its index, the texture coordinates that its slots index into, and its alpha."""

    index: int
    material: Material
    channels: tuple[UvChannel, ...]
    opacity: transparency.Opacity

    @property
    def normal_channel(self) -> int | None:
        """The channel of the normal texture, or None."""
        slot = self.material.normal_texture
        return None if slot is None else slot.uv


class Materials:
    """Reads paints; `records` holds their materials in the order of their indices."""

    def __init__(self, document: Document, mode: str):
        self.records: list[Material] = []
        self.textures = Textures(document)
        self._document = document
        self._mode = mode
        self._paints: dict[str, tuple[Paint, ...]] = {}

    def paints(self, primitive: Json) -> tuple[Paint, ...]:
        """The material of a primitive, or the default material of glTF.

        For what is partly transparent a stand-in that light meets, if any, and the material that frames blend.
        """
        if "material" in primitive:
            material = self._document.lookup("materials", primitive.get("material"))
            key = material.pointer
        else:
            material, key = Json(primitive.file, f"{primitive.pointer}/material", {}), ""
        if key not in self._paints:
            self._paints[key] = self.read(material)
        return self._paints[key]

    def read(self, material: Json) -> tuple[Paint, ...]:
        """The paints of an entry of /materials. Raises SceneError, UnsupportedError."""
        base = self._base_color(material)
        tint = min(base[0][:3]) if base[1] is None else 0.0
        opacities = transparency.read(self._document, material, self._mode, tint)
        return tuple(self._paint(material, *base, opacity) for opacity in opacities)

    def _paint(
        self, material: Json, factor: tuple[float, ...], base_texture: Json | None, opacity: transparency.Opacity
    ) -> Paint:
        channels: list[UvChannel] = []
        factor = (*factor[:3], factor[3] * opacity.factor if opacity.counts else 1.0)
        unlit = material.extension(UNLIT) is not None
        metallic, metallic_texture = (0.0, None) if unlit else self._metallic(material)
        # Skip textures that cannot affect the image.
        colored = any(factor[:3])
        emission = (0.0, 0.0, 0.0) if unlit else _emission(material)
        normal = material.get("normalTexture") if "normalTexture" in material and colored and not unlit else None
        record = Material(
            name=material.get("name", "").string(),
            base_color=factor,
            base_color_texture=self._slot(base_texture if colored or opacity.counts else None, channels),
            metallic=metallic,
            metallic_texture=self._slot(metallic_texture if colored else None, channels),
            normal_texture=self._slot(normal, channels),
            normal_scale=1.0 if normal is None else normal.get("scale", 1).number(-MAX_LIGHT, MAX_LIGHT),
            emission=emission,
            emission_texture=self._slot(_member(material, "emissiveTexture") if any(emission) else None, channels),
            alpha_cutoff=opacity.cutoff,
            double_sided=material.get("doubleSided", False).boolean(),
            unlit=unlit,
            stand_in=opacity.stand_in,
            filter=opacity.filter,
            tint=opacity.tint,
        )
        self.records.append(record)
        return Paint(len(self.records) - 1, record, tuple(channels), opacity)

    def _base_color(self, material: Json) -> tuple[tuple[float, ...], Json | None]:
        """Factor (RGBA) and textureInfo of the diffuse base colour."""
        glossy = material.extension(SPECULAR_GLOSSINESS)
        if glossy is not None:
            place = self._document.root.get("materials")
            self._document.warn(
                place, Code.SIMPLIFIED, f"{SPECULAR_GLOSSINESS}: only diffuse factors and textures count"
            )
            factor = glossy.get("diffuseFactor", [1, 1, 1, 1]).vector(4, 0, 1)
            return tuple(factor.tolist()), _member(glossy, "diffuseTexture")
        pbr = material.get("pbrMetallicRoughness", {})
        factor = pbr.get("baseColorFactor", [1, 1, 1, 1]).vector(4, 0, 1)
        return tuple(factor.tolist()), _member(pbr, "baseColorTexture")

    def _metallic(self, material: Json) -> tuple[float, Json | None]:
        """Factor and textureInfo of the metallic value."""
        if material.extension(SPECULAR_GLOSSINESS) is not None:
            return 0.0, None
        pbr = material.get("pbrMetallicRoughness", {})
        factor = pbr.get("metallicFactor", 1).number(0, 1)
        texture = _member(pbr, "metallicRoughnessTexture") if factor else None
        if "metallicFactor" not in pbr and texture is None:
            text = "metallicFactor is absent and counts as 1: the surface is a metal"
            self._document.warn(pbr, Code.SIMPLIFIED, text)
        return factor, texture

    def _slot(self, info: Json | None, channels: list[UvChannel]) -> TextureSlot | None:
        return None if info is None else self.textures.slot(info, channels)


def _member(parent: Json, key: str) -> Json | None:
    return parent.get(key) if key in parent else None


def _emission(material: Json) -> tuple[float, ...]:
    """Radiance: factor * strength."""
    factor = material.get("emissiveFactor", [0, 0, 0]).vector(3, 0, 1)
    extension = material.extension(EMISSIVE_STRENGTH)
    strength = 1.0 if extension is None else extension.get("emissiveStrength", 1).number(0, MAX_LIGHT)
    return tuple((factor * strength).tolist())
