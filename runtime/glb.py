"""A .gltf or .glb file as its JSON document and the bytes that it refers to."""

import base64
import binascii
import re
import struct
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from .errors import FileError, SceneError
from .json_value import Json, parse

MAX_JSON_BYTES = 64 << 20  # Python's objects take up to 20 times the text; room for embedded buffers
JSON_SPACE = b" \t\r\n\xef\xbb\xbf"  # white space of JSON, and a UTF-8 byte order mark
MAX_FILE_BYTES = 4 << 30  # a GLB states its length in 32 bits; a buffer larger than that is a mistake
GLB_HEADER = struct.Struct("<4sII")  # magic, version, length of the file
CHUNK_HEADER = struct.Struct("<I4s")  # length of the payload, type
SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


@dataclass(frozen=True)
class Document:
    """An open glTF file. `binary` is the GLB's BIN payload. Each file that a URI names is read once."""

    path: Path
    root: Json
    binary: bytes | None
    _files: dict[Path, bytes] = field(default_factory=dict)

    def lookup(self, kind: str, index: Json) -> Json:
        """The element of the top-level array `kind` that `index` points at; raises SceneError."""
        return _entry(self.root.get(kind, []), kind, index)

    def lookup_extension(self, name: str, kind: str, index: Json) -> Json:
        """The same for the array `kind` of the top-level extension `name`."""
        return _entry(self.root.get("extensions", {}).get(name, {}).get(kind, []), kind, index)

    def view(self, index: Json) -> memoryview:
        """The bytes of a bufferView; raises SceneError where it leaves its buffer."""
        view = self.lookup("bufferViews", index)
        data = self._buffer(view.get("buffer"))
        start = view.get("byteOffset", 0).integer()
        length = view.get("byteLength").integer(low=1)
        if start + length > len(data):
            raise view.refuse(f"bytes within a buffer of {len(data)}", f"bytes {start} to {start + length}")
        return data[start : start + length]

    def _buffer(self, index: Json) -> memoryview:
        buffer = self.lookup("buffers", index)
        length = buffer.get("byteLength").integer(low=1)
        if "uri" in buffer:
            data = self.uri(buffer.get("uri"))
        elif self.binary is not None and buffer.pointer == "/buffers/0":
            data = self.binary
        else:
            raise buffer.refuse("a uri, or the first buffer of a GLB with a BIN chunk", "neither")
        if length > len(data):
            raise buffer.refuse(f"{length} bytes", f"{len(data)}")
        return memoryview(data)[:length]

    def uri(self, uri: Json) -> bytes:
        """The bytes behind a data: URI or a relative path inside the scene's folder.

        Raises SceneError for every other URI, FileError for a file that cannot be read.
        """
        text = uri.string()
        if text.startswith("data:"):
            return _data_uri(uri, text)
        path = self._inside(uri, text)
        if path not in self._files:
            self._files[path] = read_file(path)
        return self._files[path]

    def _inside(self, uri: Json, text: str) -> Path:
        if SCHEME.match(text):
            raise uri.refuse("a data: URI or a relative path")
        folder = self.path.parent.resolve()
        try:
            name = unquote(text, errors="strict")
            path = (folder / name).resolve()
        except (ValueError, OSError, RuntimeError):  # a NUL, bytes that are not UTF-8, a loop of links
            raise uri.refuse("a path") from None
        if any(character < " " for character in name):  # error messages stay on one line
            raise uri.refuse("a path without control characters")
        if Path(name).is_absolute() or not path.is_relative_to(folder):
            raise uri.refuse("a path inside the scene's folder")
        return path


def open_document(path: Path) -> Document:
    """Read the container and its JSON. Raises FileError, SceneError."""
    data = read_file(path)
    if data[:4] != b"glTF":
        if not data.lstrip(JSON_SPACE).startswith(b"{"):
            raise SceneError(f"{path}: byte 0: expected glTF (a GLB, or JSON that starts with {{), got {data[:4]!r}")
        return Document(path, _json(data, path), None)
    chunks = _chunks(data, path)
    if not chunks or chunks[0][0] != b"JSON":
        raise SceneError(f"{path}: byte 16: expected a JSON chunk, got {chunks[0][0] if chunks else 'none'}")
    binary = next((payload for kind, payload in chunks[1:2] if kind == b"BIN\0"), None)
    return Document(path, _json(chunks[0][1], path), binary)


def read_file(path: Path) -> bytes:
    """All bytes of a regular file. Raises FileError with the path."""
    try:
        if path.exists() and not path.is_file():  # a folder, or a pipe that would block
            raise FileError(f"{path}: cannot read: not a regular file")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise FileError(f"{path}: cannot read: larger than {MAX_FILE_BYTES} bytes")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{path}: cannot read: {reason}") from None


def _entry(entries: Json, kind: str, index: Json) -> Json:
    count = len(entries.array())
    position = index.integer()
    if position >= count:
        raise index.refuse(f"an index into {count} {kind}")
    return entries.item(position)


def _json(text: bytes, path: Path) -> Json:
    if len(text) > MAX_JSON_BYTES:
        raise SceneError(f"{path}: expected JSON of at most {MAX_JSON_BYTES} bytes, got {len(text)}")
    return parse(text, str(path))


def _chunks(data: bytes, path: Path) -> list[tuple[bytes, bytes]]:
    """Type and payload of each chunk of a GLB."""
    if len(data) < GLB_HEADER.size:
        raise SceneError(f"{path}: expected a GLB header of {GLB_HEADER.size} bytes, got {len(data)}")
    _, version, length = GLB_HEADER.unpack_from(data)
    if version != 2:
        raise SceneError(f"{path}: byte 4: expected GLB version 2, got {version}")
    if length != len(data):
        raise SceneError(f"{path}: byte 8: expected a file of {length} bytes, got {len(data)}")
    chunks, start = [], GLB_HEADER.size
    while start < length:
        left = length - start - CHUNK_HEADER.size
        size, kind = CHUNK_HEADER.unpack_from(data, start) if left >= 0 else (0, b"")
        if size > left:
            raise SceneError(f"{path}: byte {start}: expected a chunk of {size} bytes, got {max(left, 0)}")
        start += CHUNK_HEADER.size
        chunks.append((kind, data[start : start + size]))
        start += size
    return chunks


def _data_uri(uri: Json, text: str) -> bytes:
    header, comma, payload = text.partition(",")
    if not comma or not header.endswith(";base64"):
        raise uri.refuse("a data: URI in base64")
    try:
        return base64.b64decode(payload, validate=True)
    except (binascii.Error, ValueError) as error:
        raise uri.refuse("base64", f"an error: {error}") from None
