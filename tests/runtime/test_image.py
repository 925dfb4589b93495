"""Image files: exact round trips, stable bytes, and refusals that name the file."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from gsgi.runtime.atomic import replacing, write_atomic
from gsgi.runtime.errors import FileError, UsageError
from gsgi.runtime.image import read_image, silent_libpng, write_image

RNG = np.random.default_rng(3)
COLOR = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
COLOR_ALPHA = RNG.integers(0, 256, (5, 7, 4), dtype=np.uint8)
RADIANCE = RNG.exponential(3, (6, 9, 3)).astype(np.float32)


def write_half(path):
    """A writer that is stopped on its way."""
    with replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise KeyboardInterrupt


def test_exr_is_exact(tmp_path):
    write_image(tmp_path / "a.exr", RADIANCE)
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), RADIANCE)


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


def test_libpng_is_silenced_and_nobody_else(capfd):
    with silent_libpng():
        os.write(2, b"libpng error: IDAT: CRC error\nfrom another thread\n")
        os.write(2, b"libpng warning: iCCP: known incorrect sRGB profile\n")
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "from another thread\nafter\n"


def test_libpng_is_silenced_without_a_stderr():
    code = "import os; os.close(2)\nfrom gsgi.runtime.image import silent_libpng\nwith silent_libpng(): print('in')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "in\n"
