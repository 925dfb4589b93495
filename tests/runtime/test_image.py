"""Image files: exact round trips, stable bytes, and refusals that name the file."""

import struct
import time
import zlib

import numpy as np
import pytest

from gsgi.runtime.atomic import replacing, write_atomic
from gsgi.runtime.errors import FileError, SceneError, UsageError
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.image import Encoded, decode_textures, read_image, write_image

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


def write_half(path):
    """A writer that is stopped on its way."""
    with replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise KeyboardInterrupt


def test_exr_is_exact(tmp_path):
    write_image(tmp_path / "a.exr", RADIANCE)
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), RADIANCE)


def test_row_0_is_the_top(tmp_path):
    data = png(1, 2, b"\0\x10\x20\x30\0\x40\x50\x60")
    (tmp_path / "a.png").write_bytes(data)
    assert decode_texture(data).tolist() == [[[16, 32, 48, 255]], [[64, 80, 96, 255]]]
    np.testing.assert_allclose(read_image(tmp_path / "a.png")[0, 0] * 255, [16, 32, 48], rtol=1e-6)


def test_png_holds_the_stored_values(tmp_path):
    write_image(tmp_path / "a.PNG", COLOR)
    image = read_image(tmp_path / "a.PNG")
    assert (image.shape, image.dtype) == ((5, 7, 3), np.float32)
    np.testing.assert_array_equal(np.round(image * 255), COLOR)


@pytest.mark.parametrize("pixels", [RADIANCE, COLOR, COLOR_ALPHA], ids=["exr", "png", "png with alpha"])
def test_bytes_depend_on_the_pixels_alone(tmp_path, pixels):
    suffix = ".exr" if pixels.dtype == np.float32 else ".png"
    first, second = tmp_path / f"first{suffix}", tmp_path / f"other{suffix}"
    write_image(first, pixels)
    time.sleep(1.1)  # file formats state the time in seconds
    write_image(second, pixels)
    assert first.read_bytes() == second.read_bytes()


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


@pytest.mark.parametrize(
    "data",
    [b"", b"GIF89a", b"\x89PNG\r\n\x1a\n", png(60_000, 60_000, b"\0"), png(20, 10, b"\0"), b"\xff\xd8\xff\xe0JFIF"],
)
def test_broken_textures(data):
    with pytest.raises(SceneError, match=r"^x: expected") as refused:
        decode_texture(data)
    assert "\n" not in str(refused.value)


def test_other_extensions_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"\.exr or \.png, got \.jpg"):
        write_image(tmp_path / "a.jpg", COLOR)
    with pytest.raises(UsageError, match="got none"):
        read_image(tmp_path / "a")


def test_unreadable_images(tmp_path):
    (tmp_path / "broken.exr").write_bytes(b"no image")
    (tmp_path / "folder.png").mkdir()
    for name in ("missing.png", "broken.exr", "folder.png"):
        with pytest.raises(FileError, match=name):
            read_image(tmp_path / name)


def test_unwritable_images(tmp_path):
    (tmp_path / "folder.png").mkdir()
    for name in ("missing/a.png", "folder.png"):
        with pytest.raises(FileError, match=name):
            write_image(tmp_path / name, COLOR)


def test_writing_is_all_or_nothing(tmp_path):
    path = tmp_path / "a.bin"
    write_atomic(path, b"old")
    with pytest.raises(KeyboardInterrupt):
        write_half(path)
    assert path.read_bytes() == b"old"
    write_atomic(path, b"new")
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a.bin", b"new")]


def test_writing_goes_through_links_and_spares_devices(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_atomic(tmp_path / "link", b"data")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"data"
    with pytest.raises(FileError, match="not a regular file"):
        write_atomic("/dev/null", b"data")


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_a_full_disk_is_named_and_the_old_image_stays(small_disk, name):
    pixels = np.random.default_rng(0).integers(0, 256, (200, 300, 3), np.uint8)
    (small_disk / name).write_bytes(b"old")
    with pytest.raises(FileError, match=r"a\.\w+: cannot write: "):
        write_image(small_disk / name, pixels if name == "a.png" else pixels.astype(np.float32))
    assert [(path.name, path.read_bytes()) for path in small_disk.iterdir()] == [(name, b"old")]
