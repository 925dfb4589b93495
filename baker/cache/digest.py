"""Digests of values: the same value has the same digest in every run and on every machine."""

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable
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
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        plain = _plain(value, pool.submit)
        text = json.dumps(plain, sort_keys=True, separators=(",", ":"), default=Future.result)
    return _hashed(text.encode())


def scene_digest(scene: Scene) -> str:
    """The digest of everything that light depends on, without cameras, names of files and meshes, and warnings.

    Light groups share the tasks of their scene's light as a whole.
    """
    meshes = tuple(dataclasses.replace(mesh, name="") for mesh in scene.meshes)
    unseen = {"cameras": {}, "warnings": (), "transparent": (), "files": (), "blended": (), "groups": {}}
    return digest(dataclasses.replace(scene, meshes=meshes, **unseen))


def _plain(value, submit: Callable[..., Future]):
    """`value` in a form that json accepts, but for the digests of large arrays, which threads compute."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        content = np.ascontiguousarray(value).reshape(-1).view(np.uint8)
        hashed = submit(_hashed, content) if len(content) > LARGE else _hashed(content)
        return [value.dtype.str, list(value.shape), hashed]
    if isinstance(value, tuple | list):
        return [_plain(item, submit) for item in value]
    if isinstance(value, dict):
        return {str(name): _plain(item, submit) for name, item in value.items()}
    if dataclasses.is_dataclass(value):
        fields = {field.name: _plain(getattr(value, field.name), submit) for field in dataclasses.fields(value)}
        return {"record": type(value).__name__} | fields
    raise TypeError(f"no digest of a {type(value).__name__}")


def _hashed(content: bytes | np.ndarray) -> str:
    return hashlib.blake2b(content, digest_size=BYTES).hexdigest()
