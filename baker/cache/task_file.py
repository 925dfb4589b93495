"""The bytes of one finished task: named arrays under a key, with a checksum. Nothing in them is executed."""

import hashlib
import json

import numpy as np

MAGIC = b"gsgitask"
CHECKSUM_BYTES = 16


def pack(key: str, arrays: dict[str, np.ndarray]) -> bytes:
    """MAGIC, length of the header (4 bytes), header (JSON: key, dtype and shape of each array), arrays, checksum."""
    shapes = {name: [array.dtype.str, array.shape] for name, array in arrays.items()}
    header = json.dumps({"key": key, "arrays": shapes}).encode()
    content = b"".join(array.tobytes() for array in arrays.values())
    data = MAGIC + len(header).to_bytes(4, "little") + header + content
    return data + _checksum(data)


def unpack(key: str, data: bytes) -> dict[str, np.ndarray] | None:
    """The arrays that were packed under `key`; None if the data is damaged or has another key."""
    content = memoryview(data)[:-CHECKSUM_BYTES]
    if data[: len(MAGIC)] != MAGIC or data[-CHECKSUM_BYTES:] != _checksum(content):
        return None
    start = len(MAGIC) + 4
    end = start + int.from_bytes(content[start - 4 : start], "little")
    header = json.loads(bytes(content[start:end]))
    return _arrays(header["arrays"], content[end:]) if header["key"] == key else None


def _arrays(shapes: dict[str, list], content: memoryview) -> dict[str, np.ndarray]:
    arrays, start = {}, 0
    for name, (dtype, shape) in shapes.items():
        arrays[name] = np.empty(shape, dtype)
        end = start + arrays[name].nbytes
        arrays[name].reshape(-1).view(np.uint8)[:] = content[start:end]
        start = end
    return arrays


def _checksum(data) -> bytes:
    return hashlib.blake2b(data, digest_size=CHECKSUM_BYTES).digest()
