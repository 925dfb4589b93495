"""The images of a scene: pixels as stored, sizes checked first, damage refused."""

import struct
import zlib

import numpy as np
import pytest

from gsgi.runtime.errors import FileError, SceneError
from gsgi.runtime.gltf.image_files import Encoded, decode_textures
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.image import read_image, write_image

RNG = np.random.default_rng(3)
COLOR = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
COLOR_ALPHA = RNG.integers(0, 256, (5, 7, 4), dtype=np.uint8)
RADIANCE = RNG.exponential(3, (6, 9, 3)).astype(np.float32)


def decode_texture(data: bytes, **limits) -> np.ndarray:
    return decode_textures([Encoded(data, "x")], Limits(**limits))[0]


def encoded(tmp_path, pixels) -> bytes:
    write_image(tmp_path / "encoded.png", pixels)
    return (tmp_path / "encoded.png").read_bytes()


def png(width: int, height: int, rows: bytes) -> bytes:
    """An RGB file by hand, each row behind its filter byte 0."""
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = (b"IHDR" + header, b"IDAT" + zlib.compress(rows), b"IEND")
    body = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(body)


def test_row_0_is_the_top(tmp_path):
    data = png(1, 2, b"\0\x10\x20\x30\0\x40\x50\x60")
    (tmp_path / "a.png").write_bytes(data)
    assert decode_texture(data).tolist() == [[[16, 32, 48, 255]], [[64, 80, 96, 255]]]
    np.testing.assert_allclose(read_image(tmp_path / "a.png")[0, 0] * 255, [16, 32, 48], rtol=1e-6)


def test_textures_keep_color_under_zero_alpha(tmp_path):
    pixels = COLOR_ALPHA.copy()
    pixels[..., 3] //= 64
    np.testing.assert_array_equal(decode_texture(encoded(tmp_path, pixels)), pixels)


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_textures_become_rgba(tmp_path, channels):
    pixels = COLOR[..., :channels]
    result = decode_texture(encoded(tmp_path, pixels))
    assert result.shape == (5, 7, 4)
    np.testing.assert_array_equal(result[..., 0], pixels[..., 0])
    np.testing.assert_array_equal(result[..., 2], pixels[..., 2 if channels == 3 else 0])
    np.testing.assert_array_equal(result[..., 3], pixels[..., 1] if channels == 2 else 255)


@pytest.mark.parametrize(
    "data",
    [b"", b"GIF89a", b"\x89PNG\r\n\x1a\n", png(60_000, 60_000, b"\0"), png(20, 10, b"\0"), b"\xff\xd8\xff\xe0JFIF"],
)
def test_broken_textures(data):
    with pytest.raises(SceneError, match=r"^x: expected") as refused:
        decode_texture(data)
    assert "\n" not in str(refused.value)


def test_a_declared_size_is_checked_first(tmp_path):
    with pytest.raises(SceneError, match=r"^x: expected at most 199 texels in all images .*--limit texels=N.*got 200"):
        decode_texture(png(20, 10, b"\0"), texels=199)
    with pytest.raises(SceneError, match=r"^y: expected at most 399 texels .*got 400"):
        decode_textures([Encoded(png(20, 10, b"\0"), "x"), Encoded(png(20, 10, b"\0"), "y")], Limits(texels=399))


def test_many_textures_keep_their_order(tmp_path):
    images = [np.full((9, 4, 3), value, np.uint8) for value in range(40)]
    files = [Encoded(encoded(tmp_path, image), "x") for image in images]
    for image, pixels in zip(images, decode_textures(files, Limits()), strict=True):
        np.testing.assert_array_equal(pixels[..., :3], image)


def test_webp_is_not_multiplied_by_alpha(tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    pixels = np.maximum(COLOR_ALPHA, np.uint8([0, 0, 0, 1]))  # the encoder itself drops colour under no alpha
    spec = oiio.ImageSpec(7, 5, 4, "uint8")
    spec.attribute("compression", "lossless")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create("webp")
    assert output.open(str(tmp_path / "a.webp"), spec)
    assert output.write_image(pixels)
    output.close()
    np.testing.assert_allclose(decode_texture((tmp_path / "a.webp").read_bytes()), pixels, atol=1)


@pytest.mark.parametrize("data", [png(9, 9, bytes(9 * 28))[:50], png(20, 10, b"\0")], ids=["cut", "short"])
def test_the_error_alone_tells_of_a_broken_png(tmp_path, capfd, data):
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(SceneError, match=r"^x: expected an image"):
        decode_texture(data)
    with pytest.raises(FileError, match=r"a\.png: cannot read"):
        read_image(tmp_path / "a.png")
    assert capfd.readouterr() == ("", "")
