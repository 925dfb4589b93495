"""Digests of values: the same value has the same digest in every run and on every machine."""

import dataclasses
import hashlib
import json
import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from gsgi.runtime.scene import Scene

BYTES = 20
LARGE = 1 << 20  # bytes; larger arrays are read on all cores


def digest(value) -> str:
    """The blake2b digest, in hex, of the canonical JSON of a value.

    The value may be a number, string, array or record, or a tuple, list or dict of those. In the JSON, an array is its
    dtype, shape and the digest of its bytes, and a record includes the name of its type. Raises TypeError for anything
    else.
    """
    return digests([value])[0]


def digests(values: Sequence) -> list[str]:
    """The digest of each of several values; arrays that they share are read once."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        arrays = _Arrays(pool)
        plain = [_plain(value, arrays) for value in values]
        texts = [json.dumps(each, sort_keys=True, separators=(",", ":"), default=Future.result) for each in plain]
    return [_hashed(text.encode()) for text in texts]


def scene_digest(scene: Scene) -> str:
    """The digest of everything that light depends on, without cameras, names of files and meshes, and warnings.

    Light groups share the tasks of their scene's light as a whole.
    """
    meshes = tuple(dataclasses.replace(mesh, name="") for mesh in scene.meshes)
    unseen = {"cameras": {}, "warnings": (), "transparent": (), "files": (), "blended": (), "groups": {}}
    return digest(dataclasses.replace(scene, meshes=meshes, **unseen))


class _Arrays:
    """Arrays in a form that json accepts, but for the digests of large ones, which threads compute.

    Those of an array that copies share are computed once.
    """

    def __init__(self, pool: ThreadPoolExecutor):
        self._pool, self._known = pool, {}

    def plain(self, array: np.ndarray) -> list:
        if id(array) not in self._known:
            content = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
            hashed = self._pool.submit(_hashed, content) if len(content) > LARGE else _hashed(content)
            self._known[id(array)] = [array.dtype.str, list(array.shape), hashed]
        return self._known[id(array)]


def _plain(value, arrays: _Arrays):
    """`value` in a form that json accepts, but for what `arrays` leave to threads."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return arrays.plain(value)
    if isinstance(value, tuple | list):
        return [_plain(item, arrays) for item in value]
    if isinstance(value, dict):
        return {str(name): _plain(item, arrays) for name, item in value.items()}
    if dataclasses.is_dataclass(value):
        fields = {field.name: _plain(getattr(value, field.name), arrays) for field in dataclasses.fields(value)}
        return {"record": type(value).__name__} | fields
    raise TypeError(f"no digest of a {type(value).__name__}")


def _hashed(content: bytes | np.ndarray) -> str:
    return hashlib.blake2b(content, digest_size=BYTES).hexdigest()
