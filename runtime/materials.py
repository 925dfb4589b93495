"""Materials of a glTF file and the textures they use, each decoded once and only when used."""

import numpy as np

from . import image
from .glb import Document
from .json_value import Json
from .scene import Material, Texture

MAX_LIGHT = 1e15  # cd, lx or radiance: float32 holds the product of two
MAX_TEXTURE_PIXELS = 2**29  # all textures of a scene: 2 GiB as RGBA, 32 of 4096 x 4096
METALLIC_DEVIATION = 25  # of 255; a texture that varies more mixes metal and other matter
WRAP = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
EMISSIVE_STRENGTH = "KHR_materials_emissive_strength"


class Materials:
    """Hands out indices into `materials` and `textures`, which grow as materials are asked for."""

    def __init__(self, document: Document):
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self.warnings: list[str] = []
        self._document = document
        self._pixels: dict[str, np.ndarray] = {}
        self._texture_index: dict[tuple, int] = {}
        self._material_index: dict[str, int] = {}

    def index(self, primitive: Json) -> int:
        """Index of the material of a mesh primitive; glTF's default one if it names none."""
        if "material" in primitive:
            material = self._document.lookup("materials", primitive.get("material"))
        else:
            material = Json(primitive.file, f"{primitive.pointer}/material", {})
        key = material.pointer if "material" in primitive else "default"
        if key not in self._material_index:
            self._material_index[key] = len(self.materials)
            self.materials.append(self._material(material))
        return self._material_index[key]

    def _material(self, material: Json) -> Material:
        pbr = material.get("pbrMetallicRoughness", {})
        emission = material.get("emissiveFactor", [0, 0, 0]).vector(3, 0, 1)
        extension = material.get("extensions", {}).get(EMISSIVE_STRENGTH, {})
        emission = emission * extension.get("emissiveStrength", 1).number(0, MAX_LIGHT)
        return Material(
            name=material.get("name", "").string(),
            base_color=tuple(pbr.get("baseColorFactor", [1, 1, 1, 1]).vector(4, 0, 1).tolist()),
            base_color_texture=self._texture(pbr, "baseColorTexture"),
            metallic=self._metallic(pbr),
            emission=tuple(emission.tolist()),
            emission_texture=self._texture(material, "emissiveTexture") if emission.any() else None,
            alpha_cutoff=self._alpha_cutoff(material),
            double_sided=material.get("doubleSided", False).boolean(),
        )

    def _alpha_cutoff(self, material: Json) -> float | None:
        mode = material.get("alphaMode", "OPAQUE").choice("OPAQUE", "MASK", "BLEND")
        if mode == "BLEND":
            self._warn(material.get("alphaMode"), "BLEND is drawn as OPAQUE")
        return material.get("alphaCutoff", 0.5).number(low=0) if mode == "MASK" else None

    def _metallic(self, pbr: Json) -> float:
        """The factor times the texture's mean: the record holds one value per material."""
        factor = pbr.get("metallicFactor", 1).number(0, 1)
        if factor and "metallicRoughnessTexture" in pbr:
            texture = self._lookup(pbr.get("metallicRoughnessTexture"))
            blue = self._decoded(texture)[..., 2]
            if blue.std() > METALLIC_DEVIATION:
                self._warn(pbr.get("metallicRoughnessTexture"), "the metallic texture counts by its mean")
            factor *= float(blue.mean()) / 255
        elif "metallicFactor" not in pbr:
            self._warn(pbr, "metallicFactor is absent and counts as 1: a metal has no diffuse light")
        return factor

    def _texture(self, parent: Json, key: str) -> int | None:
        """Index of the texture that a textureInfo names; None where there is none."""
        if key not in parent:
            return None
        info = parent.get(key)
        if info.get("texCoord", 0).integer() != 0:
            raise info.get("texCoord").unsupported("only texture coordinate set 0 is supported")
        texture = self._lookup(info)
        pixels, wrap = self._decoded(texture), self._wrap(texture)
        shared = texture.get("source").integer(), wrap
        if shared not in self._texture_index:
            self._texture_index[shared] = len(self.textures)
            self.textures.append(Texture(pixels, wrap))
        return self._texture_index[shared]

    def _lookup(self, info: Json) -> Json:
        return self._document.lookup("textures", info.get("index"))

    def _wrap(self, texture: Json) -> tuple[str, str]:
        if "sampler" not in texture:
            return "repeat", "repeat"
        sampler = self._document.lookup("samplers", texture.get("sampler"))
        return tuple(WRAP[sampler.get(key, 10497).choice(*WRAP)] for key in ("wrapS", "wrapT"))

    def _decoded(self, texture: Json) -> np.ndarray:
        """Pixels (H, W, 4) uint8 of a texture's image."""
        if "source" not in texture:
            raise texture.unsupported("a texture without a PNG or JPEG source is not supported")
        source = self._document.lookup("images", texture.get("source"))
        if source.pointer not in self._pixels:
            data = self._image_bytes(source)
            used = sum(pixels.size // 4 for pixels in self._pixels.values())
            where = f"{source.file}: {source.pointer}"
            self._pixels[source.pointer] = image.decode_texture(data, where, MAX_TEXTURE_PIXELS - used)
        return self._pixels[source.pointer]

    def _image_bytes(self, source: Json) -> bytes:
        if "uri" in source:
            return self._document.uri(source.get("uri"))
        return bytes(self._document.view(source.get("bufferView")))

    def _warn(self, value: Json, what: str):
        self.warnings.append(f"{value.file}: {value.pointer}: {what}")
