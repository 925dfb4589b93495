"""Decode the images of a glTF scene: PNG, JPEG and WebP files in memory."""

import os
import re
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gsgi.runtime.errors import SceneError
from gsgi.runtime.image import open_image, read_pixels, rgba, silent_libpng

from .limits import Limits
from .problems import Code

SIGNATURE = {
    "png": re.compile(rb"\x89PNG\r\n\x1a\n"),
    "jpg": re.compile(rb"\xff\xd8\xff"),
    "webp": re.compile(rb"RIFF....WEBP", re.DOTALL),
}


class Encoded(NamedTuple):
    """The bytes of an image file and its place: `where` starts error messages, `pointer` is the JSON pointer."""

    data: bytes
    where: str
    pointer: str = ""


def decode_textures(files: Sequence[Encoded], limits: Limits) -> list[np.ndarray]:
    """Decode PNG, JPEG and WebP files to (H, W, 4) uint8 each, with stored values and unassociated alpha.

    The declared sizes are checked against the limit before any pixel is decoded. Raises SceneError.
    """
    # The Python module of OpenImageIO can only read files.
    with (
        silent_libpng(),
        tempfile.TemporaryDirectory(prefix="gsgi-") as folder,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):
        paths = [Path(folder, f"{number}.{_kind(file)}") for number, file in enumerate(files)]
        texels = 0
        for file, path in zip(files, paths, strict=True):
            path.write_bytes(file.data)
            texels += _declared_size(file, path)
            limits.check("texels", texels, file.where, file.pointer)
        return list(pool.map(_decode_texture, files, paths))


def _kind(file: Encoded) -> str:
    for kind, start in SIGNATURE.items():
        if start.match(file.data):
            return kind
    got = f"bytes {file.data[:8].hex(' ') or 'none'}"
    raise SceneError(f"{file.where}: expected a PNG, JPEG or WebP image, got {got}", Code.IMAGE, file.pointer)


def _declared_size(file: Encoded, path: Path) -> int:
    try:
        spec = open_image(path).spec()
    except ValueError as error:
        raise _broken(file, error) from None
    return spec.width * spec.height


def _decode_texture(file: Encoded, path: Path) -> np.ndarray:
    try:
        return rgba(read_pixels(open_image(path), "uint8"))
    except ValueError as error:
        raise _broken(file, error) from None


def _broken(file: Encoded, error: ValueError) -> SceneError:
    return SceneError(f"{file.where}: expected an image, got an error: {error}", Code.IMAGE, file.pointer)
