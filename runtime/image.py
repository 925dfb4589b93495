"""Read and write images, all through OpenImageIO. Row 0 is the top."""

import errno
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .atomic import replacing
from .errors import FileError, UsageError

MAX_IMAGE_PIXELS = 2**28  # 16384 x 16384, 4 GiB as RGBA float; anything larger is a mistake or an attack
SUFFIXES = (".exr", ".png")
_PNG_END = b"IEND\xaeB`\x82"
_STDERR = 2  # the file descriptor
_stderr_lock = threading.RLock()


def read_image(path: str | Path) -> np.ndarray:
    """Read an .exr (linear) or .png (stored values / largest value) as (H, W, 3) float32.

    Grey is repeated in all three channels and alpha is dropped. Raises UsageError for other extensions, FileError.
    """
    check_image_path(path)
    try:
        with open(path, "rb"), silent_libpng():
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
    """Write (H, W, C) atomically: float32 as .exr (32 bits, lossless), uint8 as .png.

    Alpha is neither multiplied in nor divided out. The bytes depend only on the pixels. Raises UsageError for other
    extensions, FileError.
    """
    import OpenImageIO as oiio  # noqa: N813

    suffix = check_image_path(path)
    expected = np.float32 if suffix == ".exr" else np.uint8
    assert (pixels.ndim, pixels.dtype) == (3, expected), (suffix, pixels.shape, pixels.dtype)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "float" if suffix == ".exr" else "uint8")
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "")  # otherwise the EXR writer stores the current time
    spec.attribute("oiio:UnassociatedAlpha", 1)
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(suffix[1:])
        opened = output.open(str(temporary), spec)
        if not opened or not output.write_image(np.ascontiguousarray(pixels)) or not output.close():
            raise FileError(f"{path}: cannot write: {one_line(output.geterror())}")
        if suffix == ".png" and not temporary.read_bytes().endswith(_PNG_END):  # OpenImageIO reports no full disk
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def open_image(path: Path):
    """Open the first image of a file as an OpenImageIO input. Raises ValueError with a reason."""
    import OpenImageIO as oiio  # noqa: N813

    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise ValueError(one_line(oiio.geterror()))
    return source


def read_pixels(source, dtype: str) -> np.ndarray:
    """Read the pixels (H, W, C) of an open image. Raises ValueError with a reason."""
    pixels = source.read_image(dtype)
    if pixels is None:
        raise ValueError(one_line(source.geterror()))
    return pixels


@contextmanager
def silent_libpng() -> Iterator[None]:
    """Keep the lines of libpng from stderr: the exceptions of this module repeat them.

    What other threads write to stderr meanwhile appears at the end of the block.
    """
    with _stderr_lock, tempfile.TemporaryFile() as written:
        try:
            stderr = os.dup(_STDERR)
        except OSError:  # the process has no stderr
            yield
            return
        os.dup2(written.fileno(), _STDERR)
        try:
            yield
        finally:
            os.dup2(stderr, _STDERR)
            os.close(stderr)
            written.seek(0)
            others = b"".join(line for line in written if not line.startswith(b"libpng "))
            os.write(_STDERR, others)


def rgba(pixels: np.ndarray) -> np.ndarray:
    """Convert grey, grey and alpha, RGB or RGBA to four channels (H, W, 4)."""
    channels = pixels.shape[2]
    opaque = np.full(pixels.shape[:2], 255 if pixels.dtype == np.uint8 else 1, pixels.dtype)
    color = [pixels[..., k if channels >= 3 else 0] for k in range(3)]
    alpha = pixels[..., -1] if channels in (2, 4) else opaque
    return np.stack([*color, alpha], axis=2)  # a third of the time of joining colours and alpha


def check_image_path(path: str | Path) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"{path}: expected a file name in {' or '.join(SUFFIXES)}, got {suffix or 'none'}")
    return suffix


def one_line(text: str) -> str:
    """Put an error message of OpenImageIO on one line."""
    return "; ".join(text.split("\n")) or "an error without a message"
