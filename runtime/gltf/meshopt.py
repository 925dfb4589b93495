"""Decode buffer views compressed with meshoptimizer: EXT_meshopt_compression and KHR_meshopt_compression."""

import ctypes

import numpy as np

from .json_value import Json
from .limits import Limits
from .problems import Code

NAMES = ("KHR_meshopt_compression", "EXT_meshopt_compression")
MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
STRIDES = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,), "EXPONENTIAL": range(4, 257, 4)}  # bytes per element


def extension(view: Json) -> Json | None:
    """The extension object of a compressed bufferView, or None."""
    found = (view.extension(name) for name in NAMES)
    return next((compressed for compressed in found if compressed is not None), None)


def decode(view: Json, compressed: Json, data: bytes, limits: Limits) -> np.ndarray:
    """Decompress `data` to the bytes of a bufferView, (byteLength,) uint8.

    Sizes are checked before anything is allocated. Raises SceneError, and UnsupportedError for the filter COLOR or if
    the package is not installed.
    """
    mode = compressed.get("mode").choice(*MODES)
    kind = compressed.get("filter", "NONE").choice("NONE", "COLOR", *STRIDES)
    count, stride = _shape(view, compressed, mode, kind)
    limits.check("elements", count, compressed.where(), compressed.pointer)
    try:
        from meshoptimizer import decoder
    except ImportError:
        raise compressed.unsupported(
            "needs meshoptimizer: install gsgi with its extra 'decoders'", Code.NOT_INSTALLED
        ) from None
    try:
        if mode == "ATTRIBUTES":
            values = decoder.decode_vertex_buffer(count, stride, data, np.dtype(f"V{stride}"))
        elif mode == "TRIANGLES":
            values = decoder.decode_index_buffer(count, stride, data)
        else:
            values = decoder.decode_index_sequence(count, stride, data)
    except (RuntimeError, ValueError) as error:
        raise compressed.refuse("data that meshoptimizer decodes", f"an error: {error}", Code.DECODE) from None
    # 2-byte indices are packed at the start of an array of 4-byte integers.
    values = values.view(np.uint8)[: count * stride]
    return _filtered(decoder, values, kind, count, stride)


def _shape(view: Json, compressed: Json, mode: str, kind: str) -> tuple[int, int]:
    """Count and stride, checked against mode, filter and bufferView."""
    count = compressed.get("count").integer(low=1)
    stride = compressed.get("byteStride").integer(low=1, high=256)
    if stride not in ((2, 4) if mode != "ATTRIBUTES" else range(4, 257, 4)):
        raise compressed.get("byteStride").refuse(f"a stride for {mode}")
    if mode == "TRIANGLES" and count % 3:
        raise compressed.get("count").refuse("a multiple of 3")
    if kind == "COLOR":
        raise compressed.get("filter").unsupported("the filter COLOR is not supported")
    if kind != "NONE" and (mode != "ATTRIBUTES" or stride not in STRIDES[kind]):
        raise compressed.get("filter").refuse(f"a filter for {mode} of {stride} bytes")
    length = view.get("byteLength").integer(low=1)
    if length != count * stride:
        raise view.refuse(f"a byteLength of count * byteStride = {count * stride}", str(length), Code.COUNT_MISMATCH)
    return count, stride


def _filtered(decoder, values: np.ndarray, kind: str, count: int, stride: int) -> np.ndarray:
    """Undo the filter. The package declares no ctypes argument types, so sizes are passed as c_size_t."""
    filters = {
        "OCTAHEDRAL": decoder.decode_filter_oct,
        "QUATERNION": decoder.decode_filter_quat,
        "EXPONENTIAL": decoder.decode_filter_exp,
    }
    if kind == "NONE":
        return values
    return filters[kind](values, ctypes.c_size_t(count), ctypes.c_size_t(stride))
