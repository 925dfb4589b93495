"""Accessors of a glTF file as numpy arrays; every length is checked before an array is made."""

import numpy as np

from .glb import Document
from .json_value import Json

COMPONENT = {
    5120: np.dtype("i1"), 5121: np.dtype("u1"), 5122: np.dtype("<i2"),
    5123: np.dtype("<u2"), 5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
FLOAT, BYTE, SHORT, INT = 5126, 5121, 5123, 5125
MAX_STRIDE = 252  # bytes; the specification's


def floats(document: Document, index: Json, kind: str, normalized: tuple[int, ...] = ()) -> np.ndarray:
    """An accessor of type `kind` ("VEC3", ...) as (count, width) float32, finite.

    Component types in `normalized` are taken too and mapped to [0, 1]. Raises SceneError, UnsupportedError.
    """
    accessor = document.lookup("accessors", index)
    accessor.get("type").choice(kind)
    component = accessor.get("componentType").choice(FLOAT, *normalized)
    if component != FLOAT and not accessor.get("normalized", False).boolean():
        raise accessor.refuse("normalized integers", "plain ones")
    values = _decode(document, accessor)
    if component != FLOAT:
        return values.astype(np.float32) / np.iinfo(values.dtype).max
    if not np.isfinite(values).all():
        raise accessor.refuse("finite numbers", "NaN or infinity")
    return np.ascontiguousarray(values, np.float32)


def indices(document: Document, index: Json, vertex_count: int) -> np.ndarray:
    """Vertex indices (count,) uint32, all below `vertex_count`. Raises SceneError, UnsupportedError."""
    accessor = document.lookup("accessors", index)
    accessor.get("type").choice("SCALAR")
    accessor.get("componentType").choice(BYTE, SHORT, INT)
    values = _decode(document, accessor)[:, 0]
    # The type's greatest value restarts a primitive and never names a vertex.
    limit = min(vertex_count, np.iinfo(values.dtype).max)
    if values.max() >= limit:
        raise accessor.refuse(f"indices below {limit}", str(values.max()))
    return values.astype(np.uint32)


def _decode(document: Document, accessor: Json) -> np.ndarray:
    """View (count, width) of the accessor's bytes, in its own component type."""
    if "sparse" in accessor:
        raise accessor.get("sparse").unsupported("sparse accessors are not supported")
    if "bufferView" not in accessor:
        raise accessor.unsupported("accessors without a bufferView are not supported")
    dtype = COMPONENT[accessor.get("componentType").choice(*COMPONENT)]
    shape = accessor.get("count").integer(low=1), WIDTH[accessor.get("type").choice(*WIDTH)]
    element = shape[1] * dtype.itemsize
    view = document.view(accessor.get("bufferView"))
    stride = _stride(document, accessor, element)
    offset = accessor.get("byteOffset", 0).integer()
    if offset % dtype.itemsize or stride % dtype.itemsize:
        raise accessor.refuse(f"elements aligned to {dtype.itemsize} bytes", f"{offset} and {stride}")
    end = offset + (shape[0] - 1) * stride + element
    if end > len(view):
        raise accessor.refuse(f"elements within a bufferView of {len(view)} bytes", f"{end} bytes")
    return np.ndarray(shape, dtype, view, offset, (stride, dtype.itemsize))


def _stride(document: Document, accessor: Json, element: int) -> int:
    view = document.lookup("bufferViews", accessor.get("bufferView"))
    return view.get("byteStride", element).integer(low=element, high=max(element, MAX_STRIDE))
