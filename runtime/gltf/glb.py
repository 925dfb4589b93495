"""Open the container of a glTF scene: a JSON file, or a GLB with its chunks."""

import struct
from pathlib import Path

from gsgi.runtime.errors import SceneError

from .document import Document
from .json_value import Json, parse
from .limits import Limits
from .problems import Code
from .uri import Files, read_scene_file

JSON_SPACE = b" \t\r\n\xef\xbb\xbf"  # JSON white space and the UTF-8 byte order mark
GLB_HEADER = struct.Struct("<4sII")  # magic, version, file length
CHUNK_HEADER = struct.Struct("<I4s")  # payload length, type
READ_CHUNKS = 2  # JSON and BIN


def open_document(path: Path, limits: Limits) -> Document:
    """Read the container and its JSON. Raises FileError, SceneError."""
    data = read_scene_file(path, limits)
    files = Files(path.parent, limits)
    if data[:4] != b"glTF":
        if not data.lstrip(JSON_SPACE).startswith(b"{"):
            raise _damaged(path, 0, "glTF (a GLB, or JSON that starts with {)", repr(data[:4]))
        return Document(path, _json(data, path, limits), None, limits, files)
    chunks, unread = _chunks(data, path)
    if not chunks or chunks[0][0] != b"JSON":
        raise _damaged(path, 16, "a JSON chunk", str(chunks[0][0]) if chunks else "none")
    binary = next((payload for kind, payload in chunks[1:2] if kind == b"BIN\0"), None)
    document = Document(path, _json(chunks[0][1], path, limits), binary, limits, files)
    if unread:
        document.warn(document.root, Code.TRAILING_BYTES, f"{unread} bytes after the last chunk are ignored")
    return document


def _json(text: bytes, path: Path, limits: Limits) -> Json:
    limits.check("json_bytes", len(text), str(path))
    return parse(text, str(path))


def _chunks(data: bytes, path: Path) -> tuple[list[tuple[bytes, bytes]], int]:
    """Type and payload of each chunk of a GLB, and the number of bytes after the last one."""
    if len(data) < GLB_HEADER.size:
        raise _damaged(path, 0, f"a GLB header of {GLB_HEADER.size} bytes", str(len(data)))
    _, version, length = GLB_HEADER.unpack_from(data)
    if version != 2:
        raise _damaged(path, 4, "GLB version 2", str(version))
    if length > len(data):
        raise _damaged(path, 8, f"a file of {length} bytes", str(len(data)))
    chunks, start = [], GLB_HEADER.size
    while start + CHUNK_HEADER.size <= length:
        left = length - start - CHUNK_HEADER.size
        size, kind = CHUNK_HEADER.unpack_from(data, start)
        if size > left:
            if len(chunks) < READ_CHUNKS:
                raise _damaged(path, start, f"a chunk of {size} bytes", str(left))
            break
        start += CHUNK_HEADER.size
        chunks.append((kind, data[start : start + size]))
        start += size
    return chunks, len(data) - start


def _damaged(path: Path, byte: int, expected: str, got: str) -> SceneError:
    return SceneError(f"{path}: byte {byte}: expected {expected}, got {got}", Code.CONTAINER)
