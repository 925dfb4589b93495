"""Read textures of a glTF file: images (decoded once, and only if used), samplers and texture coordinates."""

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
    """A set of texture coordinates and its affine transform, the rows of [matrix | offset], (2, 3)."""

    set: int
    transform: tuple[tuple[float, ...], ...]

    def transformed(self, uv: np.ndarray) -> np.ndarray:
        """Apply the transform to texture coordinates: (V, 2) float64."""
        matrix = np.array(self.transform)
        return uv @ matrix[:, :2].T + matrix[:, 2]


class Textures:
    """Assigns texture slots; `decode` then creates the textures in the order of their indices."""

    def __init__(self, document: Document):
        self._document = document
        self._index: dict[tuple, int] = {}  # by image, wrap and filter
        self._sources: dict[str, Json] = {}

    def slot(self, info: Json, channels: list[UvChannel]) -> TextureSlot | None:
        """The slot of a textureInfo; None, with a warning, if its texture has no image.

        New texture coordinates are appended to the `channels` of the material.
        """
        texture = self._document.lookup("textures", info.get("index"))
        source, sampler, channel = self._source(texture), self._sampler(texture), _channel(info)
        if source is None:
            self._document.warn(texture, Code.NO_SOURCE, "a texture without an image is left out")
            return None
        self._sources[source.pointer] = source
        if channel not in channels:
            channels.append(channel)
        key = (source.pointer, *sampler)
        return TextureSlot(self._index.setdefault(key, len(self._index)), channels.index(channel))

    def decode(self) -> tuple[Texture, ...]:
        """Decode all textures, each image once. Raises SceneError, FileError."""
        sources = list(self._sources.values())
        pixels = dict(zip(self._sources, decode_images(self._document, sources), strict=True))
        return tuple(Texture(pixels[pointer], wrap, nearest) for pointer, wrap, nearest in self._index)

    def _source(self, texture: Json) -> Json | None:
        """The image of a texture: the WebP image if it has one, else the PNG or JPEG image, else None."""
        webp = texture.extension(WEBP)
        if webp is not None and "source" in webp:
            return self._document.lookup("images", webp.get("source"))
        if "source" not in texture:
            if texture.get("extensions", {}).object():
                raise texture.unsupported("a texture without a PNG, JPEG or WebP source is not supported")
            return None
        if texture.extension(BASISU) is not None:
            self._document.warn(texture, Code.EXTENSION_IGNORED, f"{BASISU} is ignored: the plain image is used")
        return self._document.lookup("images", texture.get("source"))

    def _sampler(self, texture: Json) -> tuple[tuple[str, str], bool]:
        if "sampler" not in texture:
            return ("repeat", "repeat"), False
        return sampling(self._document.lookup("samplers", texture.get("sampler")))


def decode_images(document: Document, sources: list[Json]) -> list[np.ndarray]:
    """Decode entries of /images to pixels (H, W, 4) uint8. Raises SceneError, FileError."""
    files = []
    for source in sources:
        if not ("uri" in source or "bufferView" in source):
            raise source.refuse("a uri or a bufferView", "neither", Code.MISSING)
        data = document.uri(source.get("uri")) if "uri" in source else bytes(document.view(source.get("bufferView")))
        files.append(Encoded(data, source.where(), source.pointer))
    return decode_textures(files, document.limits)


def sampling(sampler: Json) -> tuple[tuple[str, str], bool]:
    """Wrap mode per axis of an entry of /samplers, and whether it filters by nearest texel. Raises SceneError."""
    wrap = tuple(WRAP[sampler.get(key, 10497).choice(*WRAP)] for key in ("wrapS", "wrapT"))
    return wrap, sampler.get("magFilter", LINEAR).choice(NEAREST, LINEAR) == NEAREST


def _channel(info: Json) -> UvChannel:
    """Texture coordinate set and transform of a textureInfo.

    Source: KHR_texture_transform; the direction of rotation follows its test model. v points down, so a
    counter-clockwise rotation turns u towards -v.
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
