"""What must hold of any bytes at all: they are read, or refused in one line of text."""

import json
import random
import struct
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from gltf_files import JUNK, encode, is_refused, pointers, put
from gsgi_files import reseal

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import HEADER
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

NAMES = "position", "rotation", "scale", "opacity", "sh", "slope"


def gsgi(data: bytes) -> None:
    """A .gsgi file, as it is and with a correct checksum: refused, or Gaussians that renderer and encoder can take."""
    for file in (data, reseal(data)) if len(data) >= HEADER.itemsize else (data,):
        bake = _decoded(file)
        if bake is None:
            continue
        assert (bake.coarse is not None) == isinstance(bake.blend, SurfaceBlend)
        for level in filter(None, (bake.gaussians, bake.coarse)):
            assert all(np.isfinite(getattr(level, name)).all() for name in NAMES)
            assert (level.scale > 0).all()
            assert level.sh[:, 0].min(initial=0) >= 0
            np.testing.assert_allclose(np.linalg.norm(level.rotation, axis=1), 1, rtol=1e-5)
        codec.decode(codec.encode(bake))


def _decoded(data: bytes) -> Bake | None:
    """The bake, or None if the file is refused in one line."""
    try:
        return codec.decode(data)
    except FormatError as error:
        message = str(error)
    assert "\n" not in message, message
    return None


def gltf(data: bytes) -> None:
    """A .glb or .gltf file: `validate` finds an error in it exactly if `read_gltf` refuses it."""
    _scratch().write_bytes(data)
    found = [problem for problem in validate(_scratch()) if problem.severity == "error"]
    assert bool(found) == is_refused(read_gltf, _scratch()), found


def mutated_gltf(data: bytes, size: int, seed: int, mutate) -> bytes:
    """Another file: mostly with one value of its JSON changed, so that mutants get past the parser.

    `mutate(bytes, size)` is libFuzzer's own.
    """
    rng = random.Random(seed)
    parts = _parts(data)
    if parts is None or rng.random() < 0.1:
        return mutate(data, size)
    document, chunk = parts
    kind = rng.random()
    if kind < 0.2 and chunk:
        return encode(document, mutate(chunk, len(chunk) + 64))[:size]
    if kind < 0.3:
        return _glb(mutate(json.dumps(document).encode(), size), chunk)[:size]
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = [place for place in pointers(document) if _reaches(document, place)]
        if not places:
            break
        place = rng.choice(places)
        value = rng.choice((*JUNK, *(_at(document, rng.choice(places)) for _ in range(len(JUNK)))))
        document = put(document, place, value) if rng.random() < 0.9 else _without(document, place)
    return encode(document, chunk)[:size]


TARGETS = {"gsgi": (gsgi, None), "gltf": (gltf, mutated_gltf)}


@cache
def _scratch() -> Path:
    return Path(tempfile.mkdtemp()) / "scene.glb"


def _parts(data: bytes) -> tuple[dict, bytes] | None:
    """The JSON and the BIN chunk of a GLB file that has both."""
    try:
        length = struct.unpack_from("<I", data, 12)[0]
        document = json.loads(data[20 : 20 + length])
        return (document, data[28 + length :]) if isinstance(document, dict) else None
    except (struct.error, ValueError, RecursionError):
        return None


def _glb(text: bytes, chunk: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(chunk), b"BIN\0") + chunk
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _at(document, pointer: str):
    for key in pointer.strip("/").split("/"):
        document = document[int(key) if isinstance(document, list) else key]
    return document


def _reaches(document, pointer: str) -> bool:
    """Whether the pointer leads to a value: keys that fuzzing made may hold slashes."""
    try:
        _at(document, pointer)
    except (KeyError, ValueError, IndexError, TypeError):
        return False
    return True


def _without(document: dict, pointer: str) -> dict:
    """A copy of the document without the value at a JSON pointer."""
    copy = json.loads(json.dumps(document))
    parent, _, last = pointer.rpartition("/")
    place = _at(copy, parent) if parent else copy
    del place[int(last) if isinstance(place, list) else last]
    return copy
