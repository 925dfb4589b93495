"""Resolve the URIs of a glTF file: data: URIs, and files inside the scene's folder."""

import base64
import binascii
import re
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes

from gsgi.runtime.errors import FileError
from gsgi.runtime.files import inside, read_file

from .json_value import Json
from .limits import Limits
from .problems import Code

SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


class Files:
    """The files in the folder of a scene; each is read once."""

    def __init__(self, folder: Path, limits: Limits):
        self._named, self._folder = folder, folder.resolve()
        self._limits = limits
        self._bytes: dict[Path, bytes] = {}
        self._names: dict[Path, None] = {}

    @property
    def names(self) -> tuple[Path, ...]:
        """The files read so far, with paths as spelled by the scene's path and its URIs."""
        return tuple(self._names)

    def read(self, uri: Json) -> bytes:
        """The bytes of a data: URI, or of the file at a relative path inside the folder.

        Raises SceneError for every other URI, and FileError for a file that cannot be read.
        """
        text = uri.string()
        if text.startswith("data:"):
            return _data_uri(uri, text)
        name, path = self._inside(uri, text)
        self._names[self._named / name] = None
        if path not in self._bytes:
            try:
                self._bytes[path] = read_scene_file(path, self._limits)
            except FileError as error:
                raise FileError(f"{uri.where()}: {error}", Code.FILE, uri.pointer) from None
        return self._bytes[path]

    def _inside(self, uri: Json, text: str) -> tuple[str, Path]:
        """The file that a URI names, relative to the scene's folder, and its resolved path."""
        if SCHEME.match(text):
            raise uri.refuse("a data: URI or a relative path", code=Code.URI)
        try:
            name = unquote(text, errors="strict")
            path = inside(self._folder, name)
        except (ValueError, OSError, RuntimeError):  # a NUL, bytes that are not UTF-8, a loop of symbolic links
            raise uri.refuse("a path", code=Code.URI) from None
        if any(character < " " for character in name):  # keeps error messages on one line
            raise uri.refuse("a path without control characters", code=Code.URI)
        if path is None:
            raise uri.refuse("a path inside the scene's folder", code=Code.URI_OUTSIDE)
        return name, path


def read_scene_file(path: Path, limits: Limits) -> bytes:
    """All bytes of a regular file. Raises FileError, and SceneError if it exceeds the limit."""
    return read_file(path, lambda size: limits.check("file_bytes", size, str(path)))


def _data_uri(uri: Json, text: str) -> bytes:
    """Decode a data: URI (RFC 2397), base64 or percent-encoded."""
    header, comma, payload = text.partition(",")
    if not comma:
        raise uri.refuse("a data: URI with a comma", code=Code.URI)
    try:
        if header.endswith(";base64"):
            return base64.b64decode(unquote(payload), validate=True)
        return unquote_to_bytes(payload)
    except (binascii.Error, ValueError) as error:
        raise uri.refuse("base64", f"an error: {error}", Code.URI) from None
