"""Environment images: read as they are, averaged by solid angle, refused when they are no light."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from gsgi.runtime import environment
from gsgi.runtime.environment import read_environment
from gsgi.runtime.errors import FileError, SceneError
from gsgi.runtime.image import write_image


def solid_angles(rows: int, columns: int) -> np.ndarray:
    edges = np.cos(np.linspace(0, np.pi, rows + 1))
    return np.repeat((edges[:-1] - edges[1:])[:, None] * 2 * np.pi / columns, columns, axis=1)


def test_a_small_exr_comes_as_it_is(tmp_path):
    image = np.random.default_rng(0).random((4, 8, 3)).astype(np.float32) * 1e4
    write_image(tmp_path / "sky.exr", image)
    np.testing.assert_array_equal(read_environment(tmp_path / "sky.exr"), image)


def test_an_hdr_comes_within_its_precision(tmp_path):
    image = np.random.default_rng(0).uniform(0.5, 1, (16, 32, 3)).astype(np.float32) * 300
    output = oiio.ImageOutput.create(str(tmp_path / "sky.hdr"))
    output.open(str(tmp_path / "sky.hdr"), oiio.ImageSpec(32, 16, 3, "float"))
    output.write_image(image)
    output.close()
    read = read_environment(tmp_path / "sky.hdr")
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, image, rtol=0.02)


def test_channels(tmp_path):
    grey = np.random.default_rng(0).random((2, 4, 1)).astype(np.float32)
    write_image(tmp_path / "grey.exr", grey)
    np.testing.assert_array_equal(read_environment(tmp_path / "grey.exr"), np.repeat(grey, 3, axis=2))
    rgba = np.random.default_rng(0).random((2, 4, 4)).astype(np.float32)
    write_image(tmp_path / "rgba.exr", rgba)
    np.testing.assert_array_equal(read_environment(tmp_path / "rgba.exr"), rgba[..., :3])


@pytest.mark.parametrize("shape", [(8, 16), (7, 13), (4, 8), (9, 3), (1, 1)])
def test_a_large_image_keeps_its_light(monkeypatch, shape):
    monkeypatch.setattr(environment, "TEXELS", (8, 4))
    monkeypatch.setattr(environment, "BAND_ROWS", 3)
    image = np.random.default_rng(1).random((*shape, 3)).astype(np.float32)
    image[0, 0] = 1e4  # a sun
    small = environment._reduce(image)
    assert small.shape == (min(shape[0], 4), min(shape[1], 8), 3)
    flux = [(a * solid_angles(*a.shape[:2])[..., None]).sum(axis=(0, 1)) for a in (image, small)]
    np.testing.assert_allclose(*flux, rtol=1e-5)
    np.testing.assert_allclose(environment._reduce(np.full((*shape, 3), 2.5, np.float32)), 2.5, rtol=1e-6)


def test_an_even_factor_averages_blocks(monkeypatch):
    monkeypatch.setattr(environment, "TEXELS", (4, 8))
    image = np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)
    expected = image.reshape(8, 4, 4, 3).mean(axis=2)
    np.testing.assert_allclose(environment._reduce(image), expected, rtol=1e-5)


def test_values_that_are_no_radiance_are_counted(tmp_path):
    image = np.ones((4, 8, 3), np.float32)
    image[0, 0, 0], image[1, 2, 1], image[1, 2, 2], image[3, 3, 0] = np.nan, np.inf, -1, -0.5
    write_image(tmp_path / "bad.exr", image)
    with pytest.raises(SceneError, match=r"bad.exr: expected finite radiance of at least 0, got 3 other texels"):
        read_environment(tmp_path / "bad.exr")


def test_a_huge_image_is_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr(environment, "SIZE_MAX", (8, 4))
    write_image(tmp_path / "wide.exr", np.ones((4, 9, 3), np.float32))
    with pytest.raises(SceneError, match="at most 8 x 4 texels, got 9 x 4"):
        read_environment(tmp_path / "wide.exr")


def test_other_files_are_refused(tmp_path):
    with pytest.raises(SceneError, match=r"sky.png: expected an environment image in .hdr or .exr"):
        read_environment(tmp_path / "sky.png")
    with pytest.raises(FileError, match=r"nowhere.exr: cannot read: No such file"):
        read_environment(tmp_path / "nowhere.exr")
    for name in ("sky.exr", "sky.hdr"):
        (tmp_path / name).write_bytes(b"no image at all")
        with pytest.raises(FileError, match=rf"{name}: cannot read: "):
            read_environment(tmp_path / name)
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(FileError, match="directory"):
        read_environment(tmp_path / "folder.exr")
