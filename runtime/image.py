"""Images in and out, all through OpenImageIO. Row 0 is the top."""

import tempfile
from pathlib import Path

import numpy as np

from .atomic import replacing
from .errors import FileError, SceneError, UsageError

MAX_IMAGE_PIXELS = 2**28  # 16384 x 16384, 4 GiB as RGBA float: larger is a mistake or an attack
SIGNATURE = {b"\x89PNG\r\n\x1a\n": "png", b"\xff\xd8\xff": "jpg"}
SUFFIXES = (".exr", ".png")


def decode_texture(data: bytes, where: str, max_pixels: int = MAX_IMAGE_PIXELS) -> np.ndarray:
    """Decode a PNG or JPEG to (H, W, 4) uint8, values as stored, alpha not multiplied in.

    The declared size is held against `max_pixels` before a pixel is decoded. Raises SceneError that starts with
    `where`.
    """
    kind = next((kind for start, kind in SIGNATURE.items() if data.startswith(start)), None)
    if kind is None:
        raise SceneError(f"{where}: expected a PNG or JPEG image, got bytes {data[:8].hex(' ') or 'none'}")
    # OpenImageIO's Python module reads files only.
    with tempfile.TemporaryDirectory(prefix="gsgi-") as folder:
        file = Path(folder, f"texture.{kind}")
        file.write_bytes(data)
        try:
            pixels = _read(file, "uint8", max_pixels)
        except ValueError as error:
            raise SceneError(f"{where}: expected a {kind.upper()} image, got {error}") from None
    return _rgba(pixels)


def read_image(path: str | Path) -> np.ndarray:
    """Read an .exr (linear) or .png (stored values / greatest value) as (H, W, 3) float32.

    One channel counts for all three, alpha is left out. Raises UsageError for other extensions, FileError.
    """
    check_image_path(path)
    try:
        with open(path, "rb"):
            pixels = _read(Path(path), "float", MAX_IMAGE_PIXELS)
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
            raise FileError(f"{path}: cannot write: {_one_line(output.geterror())}")


def _read(file: Path, dtype: str, max_pixels: int) -> np.ndarray:
    """Pixels (H, W, C) of the first image in a file. Raises ValueError with a reason."""
    import OpenImageIO as oiio  # noqa: N813

    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(file), config)
    if source is None:
        raise ValueError(_one_line(oiio.geterror()))
    spec = source.spec()
    if spec.width * spec.height > max_pixels:
        raise ValueError(f"{spec.width} x {spec.height} pixels where {max_pixels} are allowed")
    pixels = source.read_image(dtype)
    if pixels is None:
        raise ValueError(_one_line(source.geterror()))
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


def _one_line(text: str) -> str:
    return "; ".join(text.split("\n")) or "an error without a message"
