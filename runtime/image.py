"""Images in and out, all through OpenImageIO. Row 0 is the top."""

import errno
import os
import re
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.gltf.problems import Code

from .atomic import replacing
from .errors import FileError, SceneError, UsageError

MAX_IMAGE_PIXELS = 2**28  # 16384 x 16384, 4 GiB as RGBA float: larger is a mistake or an attack
SIGNATURE = {
    "png": re.compile(rb"\x89PNG\r\n\x1a\n"),
    "jpg": re.compile(rb"\xff\xd8\xff"),
    "webp": re.compile(rb"RIFF....WEBP", re.DOTALL),
}
SUFFIXES = (".exr", ".png")
_PNG_END = b"IEND\xaeB`\x82"


class Encoded(NamedTuple):
    """The bytes of an image file, and its place in a scene: as errors begin, and its JSON pointer alone."""

    data: bytes
    where: str
    pointer: str = ""


def decode_textures(files: Sequence[Encoded], limits: Limits) -> list[np.ndarray]:
    """Decode PNG, JPEG and WebP files to (H, W, 4) uint8 each, values as stored, alpha not multiplied in.

    The declared sizes are held against the limit before a pixel is decoded. Raises SceneError.
    """
    # OpenImageIO's Python module reads files only.
    with tempfile.TemporaryDirectory(prefix="gsgi-") as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
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
        return _rgba(_pixels(open_image(path), "uint8"))
    except ValueError as error:
        raise _broken(file, error) from None


def _broken(file: Encoded, error: ValueError) -> SceneError:
    return SceneError(f"{file.where}: expected an image, got an error: {error}", Code.IMAGE, file.pointer)


def read_image(path: str | Path) -> np.ndarray:
    """Read an .exr (linear) or .png (stored values / greatest value) as (H, W, 3) float32.

    One channel counts for all three, alpha is left out. Raises UsageError for other extensions, FileError.
    """
    check_image_path(path)
    try:
        with open(path, "rb"):
            source = open_image(Path(path))
        spec = source.spec()
        if spec.width * spec.height > MAX_IMAGE_PIXELS:
            raise ValueError(f"{spec.width} x {spec.height} pixels where {MAX_IMAGE_PIXELS} are allowed")
        pixels = _pixels(source, "float")
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise FileError(f"{path}: cannot read: {error}") from None
    return np.ascontiguousarray(_rgba(pixels)[..., :3])


def write_image(path: str | Path, pixels: np.ndarray) -> None:
    """Write (H, W, C): float32 as .exr (32 bits, lossless), uint8 as .png; no alpha is multiplied in or out.

    Atomic; the bytes depend on the pixels alone. Raises UsageError for other extensions, FileError.
    """
    import OpenImageIO as oiio  # noqa: N813

    suffix = check_image_path(path)
    expected = np.float32 if suffix == ".exr" else np.uint8
    assert (pixels.ndim, pixels.dtype) == (3, expected), (suffix, pixels.shape, pixels.dtype)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "float" if suffix == ".exr" else "uint8")
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "")  # else the EXR writer puts the time of the day
    spec.attribute("oiio:UnassociatedAlpha", 1)
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(suffix[1:])
        opened = output.open(str(temporary), spec)
        if not opened or not output.write_image(np.ascontiguousarray(pixels)) or not output.close():
            raise FileError(f"{path}: cannot write: {one_line(output.geterror())}")
        if suffix == ".png" and not temporary.read_bytes().endswith(_PNG_END):  # a full disk, of which it says nothing
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def open_image(path: Path):
    """The OpenImageIO input of a file's first image. Raises ValueError with a reason."""
    import OpenImageIO as oiio  # noqa: N813

    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise ValueError(one_line(oiio.geterror()))
    return source


def _pixels(source, dtype: str) -> np.ndarray:
    """Pixels (H, W, C) of an open image. Raises ValueError with a reason."""
    pixels = source.read_image(dtype)
    if pixels is None:
        raise ValueError(one_line(source.geterror()))
    return pixels


def _rgba(pixels: np.ndarray) -> np.ndarray:
    """Four channels (H, W, 4) from grey, grey and alpha, RGB, or RGBA."""
    channels = pixels.shape[2]
    color = pixels[..., :3] if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
    opaque = 255 if pixels.dtype == np.uint8 else 1
    alpha = pixels[..., channels - 1 :] if channels in (2, 4) else np.full_like(color[..., :1], opaque)
    return np.concatenate([color, alpha], axis=2)


def check_image_path(path: str | Path) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"{path}: expected a file name in {' or '.join(SUFFIXES)}, got {suffix or 'none'}")
    return suffix


def one_line(text: str) -> str:
    """What OpenImageIO says of an error, on one line."""
    return "; ".join(text.split("\n")) or "an error without a message"
