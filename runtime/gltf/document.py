"""An open glTF file: its JSON, the bytes that it refers to, and the warnings so far."""

from dataclasses import dataclass, field
from pathlib import Path

from . import meshopt
from .json_value import Json
from .limits import Limits
from .problems import Code, Problem
from .uri import Files


@dataclass(frozen=True)
class Document:
    """`binary` is the BIN payload of a GLB; `problems` holds each warning so far once."""

    path: Path
    root: Json
    binary: bytes | None
    limits: Limits
    files: Files
    problems: dict[Problem, None] = field(default_factory=dict)
    _decompressed: dict[str, memoryview] = field(default_factory=dict)

    def warn(self, value: Json, code: Code, what: str) -> None:
        """Record a warning at the place of a value."""
        self.problems[Problem("warning", code, value.pointer, what)] = None

    def warnings(self) -> tuple[str, ...]:
        """The warnings so far, one line each."""
        return tuple(f"{self.path}: {problem.pointer or '/'}: {problem.message}" for problem in self.problems)

    def lookup(self, kind: str, index: Json) -> Json:
        """The element at `index` of the top-level array `kind`. Raises SceneError."""
        return _entry(self.root.get(kind, []), kind, index)

    def lookup_extension(self, name: str, kind: str, index: Json) -> Json:
        """Same as `lookup` for the array `kind` of the top-level extension `name`."""
        return _entry(self.root.get("extensions", {}).get(name, {}).get(kind, []), kind, index)

    def view(self, index: Json) -> memoryview:
        """The bytes of a bufferView, decompressed. Raises SceneError if it exceeds its buffer."""
        view = self.lookup("bufferViews", index)
        compressed = meshopt.extension(view)
        if compressed is None:
            return self._slice(view)
        if view.pointer not in self._decompressed:
            data = bytes(self._slice(compressed))
            self._decompressed[view.pointer] = memoryview(meshopt.decode(view, compressed, data, self.limits))
        return self._decompressed[view.pointer]

    def _slice(self, place: Json) -> memoryview:
        """The bytes that `buffer`, `byteOffset` and `byteLength` of an object select. Raises SceneError."""
        data = self.buffer(place.get("buffer"))
        start = place.get("byteOffset", 0).integer()
        length = place.get("byteLength").integer(low=1)
        if start + length > len(data):
            got = f"bytes {start} to {start + length}"
            key = "byteLength" if start < len(data) else "byteOffset"
            raise place.get(key).refuse(f"bytes within a buffer of {len(data)}", got, Code.BOUNDS)
        return data[start : start + length]

    def uri(self, uri: Json) -> bytes:
        """The bytes that a URI refers to. Raises SceneError, FileError."""
        return self.files.read(uri)

    def has_data(self, buffer: Json) -> bool:
        """Whether an entry of /buffers has bytes: a URI, or the BIN chunk."""
        return "uri" in buffer or (self.binary is not None and buffer.pointer == "/buffers/0")

    def buffer(self, index: Json) -> memoryview:
        """The bytes of a buffer. Raises SceneError, FileError."""
        buffer = self.lookup("buffers", index)
        length = buffer.get("byteLength").integer(low=1)
        if not self.has_data(buffer):
            raise buffer.refuse("a uri, or the first buffer of a GLB with a BIN chunk", "neither", Code.MISSING)
        data = self.uri(buffer.get("uri")) if "uri" in buffer else self.binary
        if length > len(data):
            source = buffer.get("uri").string() if "uri" in buffer else "the BIN chunk"
            raise buffer.refuse(f"{length} bytes in {source:.60}", f"{len(data)}", Code.BOUNDS)
        return memoryview(data)[:length]


def _entry(entries: Json, kind: str, index: Json) -> Json:
    count = len(entries.array())
    position = index.integer()
    if position >= count:
        raise index.refuse(f"an index into {count} {kind}", code=Code.INDEX_RANGE)
    return entries.item(position)
