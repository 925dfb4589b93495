"""Read mesh primitives of a glTF file as arrays in the space of their node, with morph targets applied."""

from dataclasses import dataclass, replace

import numpy as np

from . import accessors, draco
from .accessors import SIGNED, UNSIGNED, Layout
from .document import Document
from .json_value import Json
from .materials import Paint
from .problems import Code
from .textures import UvChannel
from .triangles import MODES, TRIANGLES, leftover, triangles

ANY = (*UNSIGNED, *SIGNED)
# The integer types of KHR_mesh_quantization are accepted even if the file does not declare the extension.
LAYOUT = {
    "POSITION": Layout(("VEC3",), ANY, ANY),
    "NORMAL": Layout(("VEC3",), (), SIGNED),
    "TANGENT": Layout(("VEC4",), (), SIGNED),
    "TEXCOORD": Layout(("VEC2",), ANY, ANY),
    "COLOR": Layout(("VEC3", "VEC4"), (), UNSIGNED),
    "WEIGHTS": Layout(("VEC4",), (), UNSIGNED),
}
DELTA = Layout(("VEC3",), ANY, ANY)  # of a morph target, also for tangents


@dataclass(frozen=True)
class Primitive:
    """Triangles of one material.

    position (V, 3), normal (V, 3), uv (V, C, 2), color (V, 4), tangent (V, 4) and weights (V, J) are float32; joints
    (V, J) are unsigned; triangle (F, 3) is uint32. Absent attributes are None. If normals are absent, no two triangles
    share a vertex.
    """

    json: Json
    position: np.ndarray
    triangle: np.ndarray
    uv: np.ndarray
    normal: np.ndarray | None = None
    tangent: np.ndarray | None = None
    color: np.ndarray | None = None
    joints: np.ndarray | None = None
    weights: np.ndarray | None = None

    def __len__(self) -> int:
        """Vertices plus indices, the size of one copy."""
        return len(self.position) + self.triangle.size


class Attributes:
    """Reads the attributes of one primitive; each must have as many elements as POSITION."""

    def __init__(self, document: Document, primitive: Json):
        self._document = document
        self._json = primitive.get("attributes")
        compressed = primitive.extension(draco.NAME)
        self.draco = draco.DracoMesh(document, primitive, compressed) if compressed is not None else None
        self.count = None
        self.count = len(self.floats("POSITION"))

    def __contains__(self, name: str) -> bool:
        return name in self._json

    def floats(self, name: str) -> np.ndarray:
        layout = LAYOUT[name.partition("_")[0]]
        index = self._json.get(name)
        return self._checked(index, accessors.floats(self._document, index, layout, self._source(name)))

    def joints(self, name: str) -> np.ndarray:
        index = self._json.get(name)
        return self._checked(index, accessors.integers(self._document, index, "VEC4", self._source(name)))

    def deltas(self, target: Json, name: str) -> np.ndarray:
        index = target.get(name)
        return self._checked(index, accessors.floats(self._document, index, DELTA))

    def _source(self, name: str):
        return (self.draco, name) if self.draco is not None and name in self.draco else None

    def _checked(self, index: Json, values: np.ndarray) -> np.ndarray:
        if self.count is not None and len(values) != self.count:
            raise index.refuse(f"{self.count} elements, as POSITION", str(len(values)), Code.COUNT_MISMATCH)
        return values


def has_triangles(document: Document, primitive: Json) -> bool:
    """Whether the primitive consists of triangles. Warns about points, lines and what has no positions."""
    mode = _mode(primitive)
    if mode < TRIANGLES:
        document.warn(primitive, Code.NOT_TRIANGLES, f"{MODES[mode]} are left out")
        return False
    attributes = primitive.get("attributes")
    if "POSITION" not in attributes:
        document.warn(attributes, Code.NO_POSITION, "a primitive without POSITION is left out")
        return False
    return True


def decode(document: Document, primitive: Json, paint: Paint, weights: tuple[float, ...]) -> Primitive:
    """Decode a primitive with the texture coordinates of its material, morphed by `weights` (one per morph target).

    Raises SceneError, UnsupportedError.
    """
    attributes = Attributes(document, primitive)
    normal = _morphed(attributes, primitive, "NORMAL", weights) if "NORMAL" in attributes else None
    tangent = None
    if paint.normal_channel is not None and normal is not None and "TANGENT" in attributes:
        tangent = _morphed(attributes, primitive, "TANGENT", weights)
    joints, joint_weights = _influences(attributes)
    decoded = Primitive(
        primitive,
        _morphed(attributes, primitive, "POSITION", weights),
        _triangles(document, primitive, attributes),
        _uv(document, primitive, attributes, paint.channels),
        normal,
        tangent,
        _color(attributes),
        joints,
        joint_weights,
    )
    return decoded if normal is not None else _unshared(decoded)


def _mode(primitive: Json) -> int:
    return primitive.get("mode", TRIANGLES).integer(high=len(MODES) - 1)


def _triangles(document: Document, primitive: Json, attributes: Attributes) -> np.ndarray:
    mode = _mode(primitive)
    if attributes.draco is not None:
        if mode != TRIANGLES:
            raise primitive.get("mode").unsupported(f"{MODES[mode]} compressed by Draco are not supported")
        index = attributes.draco.index
        if index.max() >= attributes.count:
            place = primitive.extension(draco.NAME)
            raise place.refuse(f"indices below {attributes.count}", str(index.max()), Code.INDEX_RANGE)
    elif "indices" in primitive:
        index = accessors.indices(document, primitive.get("indices"), attributes.count)
    else:
        index = np.arange(attributes.count, dtype=np.uint32)
    rest = leftover(mode, len(index))
    if rest:
        text = f"{len(index)} indices or vertices: the last {rest} form no whole triangle and are left out"
        document.warn(primitive, Code.INCOMPLETE, text)
    return triangles(mode, index)


def _morphed(attributes: Attributes, primitive: Json, name: str, weights: tuple[float, ...]) -> np.ndarray:
    """An attribute plus the weighted sum of its morph targets; the w of a tangent is unchanged."""
    values = attributes.floats(name)
    if not any(weights):
        return values
    values = values.astype(np.float64)
    for target, weight in zip(primitive.get("targets").items(), weights, strict=True):
        if weight and name in target:
            values[:, :3] += weight * attributes.deltas(target, name)
    if not np.abs(values).max() <= np.finfo(np.float32).max:
        raise primitive.get("targets").refuse("a sum that float32 holds", "an overflow", Code.OVERFLOW)
    return values.astype(np.float32)


def _uv(document: Document, primitive: Json, attributes: Attributes, channels: tuple[UvChannel, ...]) -> np.ndarray:
    """Texture coordinates (V, C, 2) float32 of each channel; 0 if the primitive lacks the set."""
    uv = np.zeros((attributes.count, len(channels), 2))
    for number, channel in enumerate(channels):
        name = f"TEXCOORD_{channel.set}"
        if name not in attributes:
            document.warn(primitive, Code.NO_UV, f"{name} is absent and counts as 0, though the material uses it")
            continue
        uv[:, number] = channel.transformed(attributes.floats(name))
    if uv.size and np.abs(uv).max() > np.finfo(np.float32).max:
        raise primitive.refuse("texture coordinates that float32 holds", "an overflow", Code.OVERFLOW)
    return uv.astype(np.float32)


def _color(attributes: Attributes) -> np.ndarray | None:
    """Vertex colours (V, 4) in [0, 1], or None."""
    if "COLOR_0" not in attributes:
        return None
    color = np.ones((attributes.count, 4), np.float32)
    values = attributes.floats("COLOR_0")
    color[:, : values.shape[1]] = np.clip(values, 0, 1)
    return color


def _influences(attributes: Attributes) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Joints and weights of all sets, concatenated; None, None without sets."""
    sets = 0
    while f"JOINTS_{sets}" in attributes and f"WEIGHTS_{sets}" in attributes:
        sets += 1
    if not sets:
        return None, None
    joints = [attributes.joints(f"JOINTS_{number}") for number in range(sets)]
    weights = [attributes.floats(f"WEIGHTS_{number}") for number in range(sets)]
    return np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)


def _unshared(primitive: Primitive) -> Primitive:
    """The primitive with three vertices of its own per triangle, which flat normals require."""
    corner = primitive.triangle.reshape(-1)
    names = ("position", "uv", "color", "joints", "weights")
    arrays = {name: getattr(primitive, name) for name in names}
    arrays = {name: values if values is None else values[corner] for name, values in arrays.items()}
    return replace(primitive, **arrays, triangle=np.arange(len(corner), dtype=np.uint32).reshape(-1, 3))
