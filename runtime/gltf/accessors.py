"""Read accessors of a glTF file as numpy arrays. Every length is checked before an array is allocated."""

import json
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from .document import Document
from .draco import DracoMesh
from .json_value import Json
from .problems import Code

COMPONENT = {
    5120: np.dtype("i1"), 5121: np.dtype("u1"), 5122: np.dtype("<i2"),
    5123: np.dtype("<u2"), 5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
FLOAT = 5126
UNSIGNED, SIGNED = (5121, 5123), (5120, 5122)  # 8 and 16 bits
INDEX = (5121, 5123, 5125)
MAX_STRIDE = 252  # bytes; set by the specification


@dataclass(frozen=True)
class Layout:
    """The types that an accessor may have, and the integers that may replace float32, plain or normalized."""

    kinds: tuple[str, ...]
    plain: tuple[int, ...] = ()
    normalized: tuple[int, ...] = ()


def floats(document: Document, index: Json, layout: Layout, draco: tuple[DracoMesh, str] | None = None) -> np.ndarray:
    """An accessor as (count, width) float32, finite. Normalized integers are mapped to [0, 1] or [-1, 1].

    `draco` is a mesh and the name of its attribute, if the values are stored there. Raises SceneError,
    UnsupportedError.
    """
    accessor = document.lookup("accessors", index)
    _check_use(index, accessor, layout.kinds, {FLOAT, *layout.plain, *layout.normalized})
    component = accessor.get("componentType").data
    normalized = accessor.get("normalized", False).boolean()
    if component != FLOAT and component not in (layout.normalized if normalized else layout.plain):
        raise index.refuse(f"{accessor.pointer} with normalized {json.dumps(not normalized)}", json.dumps(normalized))
    values = elements(document, accessor) if draco is None else draco_elements(accessor, *draco)
    if component == FLOAT:
        check_finite(accessor, values)
        return np.ascontiguousarray(values, np.float32)
    result = values.astype(np.float32)
    if normalized:
        result /= np.iinfo(values.dtype).max
        np.maximum(result, -1, out=result)  # -128 counts as -127
    return result


def integers(document: Document, index: Json, kind: str, draco: tuple[DracoMesh, str] | None = None) -> np.ndarray:
    """An accessor of plain 8-bit or 16-bit unsigned integers as (count, width). Raises SceneError."""
    accessor = document.lookup("accessors", index)
    _check_use(index, accessor, (kind,), UNSIGNED)
    return elements(document, accessor) if draco is None else draco_elements(accessor, *draco)


def indices(document: Document, index: Json, vertex_count: int) -> np.ndarray:
    """Vertex indices (count,) uint32, all below `vertex_count`. Raises SceneError."""
    accessor = document.lookup("accessors", index)
    _check_use(index, accessor, ("SCALAR",), INDEX)
    values = elements(document, accessor)[:, 0]
    # The largest value of the type means primitive restart and is never a vertex index.
    limit = min(vertex_count, np.iinfo(values.dtype).max)
    if values.max() >= limit:
        raise index.refuse(f"indices below {limit}", str(values.max()), Code.INDEX_RANGE)
    return values.astype(np.uint32)


def elements(document: Document, accessor: Json) -> np.ndarray:
    """The values (count, width) in the accessor's component type, sparse values included. Do not write to the array."""
    dtype, shape = _type(accessor)
    if "bufferView" in accessor:
        values = _strided(document, accessor, dtype, shape)
    else:
        document.limits.check("elements", shape[0] * shape[1], accessor.where(), accessor.pointer)
        values = np.zeros(shape, dtype)
    return _substituted(document, accessor.get("sparse"), values) if "sparse" in accessor else values


def check_finite(accessor: Json, values: np.ndarray) -> None:
    """Raise SceneError if a value is NaN or infinite."""
    if not np.isfinite(values).all():
        raise accessor.refuse("finite numbers", "NaN or infinity", Code.NON_FINITE)


def draco_elements(accessor: Json, mesh: DracoMesh, name: str) -> np.ndarray:
    """Same as `elements` for an attribute of a Draco mesh."""
    dtype, shape = _type(accessor)
    return mesh.elements(name, accessor, dtype, shape[1])


def _check_use(index: Json, accessor: Json, kinds: Collection[str], components: Collection[int]) -> None:
    """Refuse the reference `index` if its accessor, valid in itself, is of another type than its use demands."""
    demands = ("type", WIDTH, kinds), ("componentType", COMPONENT, components)
    for key, known, allowed in demands:
        value = accessor.get(key).choice(*known)
        if value not in allowed:
            text = f"{accessor.pointer} of {key} {' or '.join(map(str, sorted(allowed)))}"
            raise index.refuse(text, str(value))


def _type(accessor: Json) -> tuple[np.dtype, tuple[int, int]]:
    dtype = COMPONENT[accessor.get("componentType").choice(*COMPONENT)]
    return dtype, (accessor.get("count").integer(low=1), WIDTH[accessor.get("type").choice(*WIDTH)])


def _strided(document: Document, place: Json, dtype: np.dtype, shape: tuple[int, int]) -> np.ndarray:
    """A view (count, width) of the bytes at the bufferView and byteOffset of `place`."""
    element = shape[1] * dtype.itemsize
    view = document.view(place.get("bufferView"))
    byte_stride = document.lookup("bufferViews", place.get("bufferView")).get("byteStride", element)
    stride = byte_stride.integer(low=1, high=max(element, MAX_STRIDE))
    byte_offset = place.get("byteOffset", 0)
    offset = byte_offset.integer()
    for value in (byte_stride, byte_offset):
        if value.data % dtype.itemsize:
            raise value.refuse(f"a multiple of {dtype.itemsize} bytes", code=Code.ALIGNMENT)
    if element > stride:
        raise place.refuse(f"elements of at most {stride} bytes, the byteStride", str(element))
    end = offset + (shape[0] - 1) * stride + element
    if end > len(view):
        place = place if offset < len(view) else byte_offset
        raise place.refuse(f"elements within a bufferView of {len(view)} bytes", f"{end} bytes", Code.BOUNDS)
    return np.ndarray(shape, dtype, view, offset, (stride, dtype.itemsize))


def _substituted(document: Document, sparse: Json, values: np.ndarray) -> np.ndarray:
    """A copy of `values` with the elements replaced that `sparse` lists."""
    count = sparse.get("count").integer(low=1, high=len(values))
    where = sparse.get("indices")
    dtype = COMPONENT[where.get("componentType").choice(*INDEX)]
    index = _strided(document, where, dtype, (count, 1))[:, 0].astype(np.int64)
    if (np.diff(index) <= 0).any():
        raise where.refuse("rising indices", "some that do not rise", Code.INDEX_RANGE)
    if index[-1] >= len(values):
        raise where.refuse(f"indices below {len(values)}", str(index[-1]), Code.INDEX_RANGE)
    values = values.copy()
    values[index] = _strided(document, sparse.get("values"), values.dtype, (count, values.shape[1]))
    return values
