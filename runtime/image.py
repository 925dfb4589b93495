"""Images in and out, all through OpenImageIO. Row 0 is the top."""

import errno
import os
from pathlib import Path

import numpy as np

from .atomic import replacing
from .errors import FileError, UsageError

MAX_IMAGE_PIXELS = 2**28  # 16384 x 16384, 4 GiB as RGBA float: larger is a mistake or an attack
SUFFIXES = (".exr", ".png")
_PNG_END = b"IEND\xaeB`\x82"


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
        pixels = read_pixels(source, "float")
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise FileError(f"{path}: cannot read: {error}") from None
    return np.ascontiguousarray(rgba(pixels)[..., :3])


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


def read_pixels(source, dtype: str) -> np.ndarray:
    """Pixels (H, W, C) of an open image. Raises ValueError with a reason."""
    pixels = source.read_image(dtype)
    if pixels is None:
        raise ValueError(one_line(source.geterror()))
    return pixels


def rgba(pixels: np.ndarray) -> np.ndarray:
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
