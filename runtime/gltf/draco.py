"""Decode primitives that are compressed with Draco: KHR_draco_mesh_compression."""

import struct

import numpy as np

from .document import Document
from .json_value import Json
from .problems import Code

NAME = "KHR_draco_mesh_compression"
MAGIC = struct.Struct("<5sBBBBH")  # "DRACO", version, subversion, geometry, method, flags
MESH, EDGEBREAKER, METADATA = 1, 1, 0x8000


class DracoMesh:
    """The decoded triangles and attributes of one primitive."""

    def __init__(self, document: Document, primitive: Json, compressed: Json):
        self._document = document
        self._ids = compressed.get("attributes")
        self._json = compressed
        data = bytes(document.view(compressed.get("bufferView")))
        vertices, faces = self._declared(data)
        document.limits.check("elements", max(vertices, 3 * faces), compressed.where(), compressed.pointer)
        mesh = self._decoded(data)
        # Where there are no triangles, DracoPy returns a cloud of points.
        self.index = getattr(mesh, "faces", np.empty(0, np.uint32)).reshape(-1)
        if len(self.index) != 3 * faces or not faces:
            raise compressed.refuse(f"{max(faces, 1)} triangles", str(len(self.index) // 3), Code.DECODE)
        self._compare_count(document.lookup("accessors", primitive.get("indices")), 3 * faces)
        self._attributes = {attribute["unique_id"]: attribute["data"] for attribute in mesh.attributes}

    def __contains__(self, name: str) -> bool:
        return name in self._ids

    def elements(self, name: str, accessor: Json, dtype: np.dtype, width: int) -> np.ndarray:
        """An attribute (V, width) in the component type of the accessor. Raises SceneError.

        V is Draco's own number of vertices: the accessor's count does not matter.
        """
        unique_id = self._ids.get(name)
        values = self._attributes.get(unique_id.integer())
        if values is None:
            raise unique_id.refuse(f"an id among {sorted(self._attributes)}", code=Code.INDEX_RANGE)
        values = values.reshape(len(values), -1)
        if values.shape[1] != width:
            raise unique_id.refuse(f"an attribute of width {width}", str(values.shape[1]), Code.COUNT_MISMATCH)
        self._compare_count(accessor, len(values))
        # DracoPy widens integers, signed ones to floats. A cast back that changes values would destroy their meaning.
        with np.errstate(invalid="ignore"):
            cast = values.astype(dtype)
        if dtype.kind != "f" and not np.array_equal(cast, values):
            raise unique_id.refuse(
                f"values that {dtype} holds, as the accessor's", f"{values.dtype}", Code.COUNT_MISMATCH
            )
        return cast

    def _compare_count(self, accessor: Json, count: int) -> None:
        """Warn if the accessor states another count than the compressed mesh has."""
        stated = accessor.get("count").integer(low=1)
        self._document.limits.check("elements", stated, accessor.where(), accessor.pointer)
        if stated != count:
            text = f"{stated} elements, but the compressed mesh has {count}, which count"
            self._document.warn(accessor.get("count"), Code.COUNT_MISMATCH, text)

    def _declared(self, data: bytes) -> tuple[int, int]:
        """Number of vertices and triangles that the stream declares, read before the decoder allocates memory for them.

        Source: Draco bitstream specification, sections "Header" and "Connectivity".
        """
        try:
            magic, major, minor, geometry, method, flags = MAGIC.unpack_from(data)
            if magic != b"DRACO" or geometry != MESH or method > EDGEBREAKER:
                raise self._json.refuse("a Draco mesh", repr(data[: MAGIC.size]), Code.DECODE)
            if (major, minor) != (2, 2) or flags & METADATA:
                raise self._json.unsupported("a Draco mesh of another version than 2.2, or with metadata")
            # With edgebreaker, a byte for the traversal type precedes the counts.
            first, start = _varint(data, MAGIC.size + (method == EDGEBREAKER))
            second, _ = _varint(data, start)
        except (struct.error, IndexError):
            raise self._json.refuse("a Draco mesh", f"{len(data)} bytes", Code.DECODE) from None
        return (first, second) if method == EDGEBREAKER else (second, first)

    def _decoded(self, data: bytes):
        try:
            import DracoPy
        except ImportError:
            raise self._json.unsupported(
                "needs DracoPy: install gsgi with its extra 'decoders'", Code.NOT_INSTALLED
            ) from None
        try:
            return DracoPy.decode(data)
        except Exception as error:  # DracoPy's exceptions have no narrower base class
            reason = " ".join(str(error).split()) or type(error).__name__
            raise self._json.refuse("data that Draco decodes", f"an error: {reason}", Code.DECODE) from None


def _varint(data: bytes, start: int) -> tuple[int, int]:
    """A LEB128 number of at most five bytes, and the offset after it. Raises IndexError at the end of the data."""
    value = 0
    for shift in range(0, 35, 7):
        byte = data[start]
        start += 1
        value |= (byte & 127) << shift
        if byte < 128:
            break
    return value, start
