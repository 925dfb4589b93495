"""Textures of a glTF file: images decoded once and only when used, samplers, and their texture coordinates."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.scene import Texture, TextureSlot

from .document import Document
from .image_files import Encoded, decode_textures
from .json_value import Json
from .problems import Code

WRAP = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
NEAREST, LINEAR = 9728, 9729
MAX_TRANSFORM = 1e9  # anything larger is a mistake
TRANSFORM, WEBP, BASISU = "KHR_texture_transform", "EXT_texture_webp", "KHR_texture_basisu"


@dataclass(frozen=True)
class UvChannel:
    """A set of texture coordinates under an affine transform: rows of [matrix | offset], (2, 3)."""

    set: int
    transform: tuple[tuple[float, ...], ...]

    def transformed(self, uv: np.ndarray) -> np.ndarray:
        """Texture coordinates (V, 2) float64."""
        matrix = np.array(self.transform)
        return uv @ matrix[:, :2].T + matrix[:, 2]


class Textures:
    """Hands out texture slots; `decode` then makes the records in the order of their indices."""

    def __init__(self, document: Document):
        self._document = document
        self._index: dict[tuple, int] = {}  # by image, wrap and filter
        self._sources: dict[str, Json] = {}

    def slot(self, info: Json, channels: list[UvChannel]) -> TextureSlot:
        """What a textureInfo names; its texture coordinates are added to the material's `channels` if they are new."""
        texture = self._document.lookup("textures", info.get("index"))
        source = self._source(texture)
        self._sources[source.pointer] = source
        channel = _channel(info)
        if channel not in channels:
            channels.append(channel)
        key = (source.pointer, *self._sampler(texture))
        return TextureSlot(self._index.setdefault(key, len(self._index)), channels.index(channel))

    def decode(self) -> tuple[Texture, ...]:
        """All textures, each image decoded once. Raises SceneError, FileError."""
        sources = list(self._sources.values())
        pixels = dict(zip(self._sources, decode_images(self._document, sources), strict=True))
        return tuple(Texture(pixels[pointer], wrap, nearest) for pointer, wrap, nearest in self._index)

    def _source(self, texture: Json) -> Json:
        """The image of a texture: WebP, else what every reader knows."""
        webp = texture.extension(WEBP)
        if webp is not None and "source" in webp:
            return self._document.lookup("images", webp.get("source"))
        if "source" not in texture:
            raise texture.unsupported("a texture without a PNG, JPEG or WebP source is not supported")
        if texture.extension(BASISU) is not None:
            self._document.warn(texture, Code.EXTENSION_IGNORED, f"{BASISU} is ignored: the plain image is used")
        return self._document.lookup("images", texture.get("source"))

    def _sampler(self, texture: Json) -> tuple[tuple[str, str], bool]:
        if "sampler" not in texture:
            return ("repeat", "repeat"), False
        return sampling(self._document.lookup("samplers", texture.get("sampler")))


def decode_images(document: Document, sources: list[Json]) -> list[np.ndarray]:
    """The pixels (H, W, 4) uint8 of entries of /images. Raises SceneError, FileError."""
    files = []
    for source in sources:
        data = document.uri(source.get("uri")) if "uri" in source else bytes(document.view(source.get("bufferView")))
        files.append(Encoded(data, source.where(), source.pointer))
    return decode_textures(files, document.limits)


def sampling(sampler: Json) -> tuple[tuple[str, str], bool]:
    """Wrap per axis of an entry of /samplers, and whether the nearest texel counts alone. Raises SceneError."""
    wrap = tuple(WRAP[sampler.get(key, 10497).choice(*WRAP)] for key in ("wrapS", "wrapT"))
    return wrap, sampler.get("magFilter", LINEAR).choice(NEAREST, LINEAR) == NEAREST


def _channel(info: Json) -> UvChannel:
    """Set and transform of a textureInfo. Source: KHR_texture_transform, with the rotation as its test model has it.

    v points down, so that counter-clockwise takes u to -v.
    """
    number = info.get("texCoord", 0).integer()
    extension = info.extension(TRANSFORM)
    if extension is None:
        return UvChannel(number, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    if "texCoord" in extension:
        number = extension.get("texCoord").integer()
    offset = extension.get("offset", [0, 0]).vector(2, -MAX_TRANSFORM, MAX_TRANSFORM)
    scale = extension.get("scale", [1, 1]).vector(2, -MAX_TRANSFORM, MAX_TRANSFORM)
    angle = extension.get("rotation", 0).number()
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.array([[cos, sin], [-sin, cos]]) * scale
    return UvChannel(number, tuple(tuple(row) for row in np.column_stack([matrix, offset]).tolist()))
