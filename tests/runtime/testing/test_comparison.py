"""Screenshots, without pytest around them: differences, drivers' names, the look-up of golden images."""

import re
from pathlib import Path

import numpy as np
import pytest

from gsgi.baker.evaluation import metrics
from gsgi.runtime.errors import UsageError
from gsgi.runtime.testing.comparison import Tolerance, as_image, compare, pixel_hash, shown
from gsgi.runtime.testing.driver import driver_of
from gsgi.runtime.testing.golden import golden_of, unused

GREY = np.full((40, 50, 3), 128, np.uint8)
RADIANCE = np.random.default_rng(0).exponential(2, (40, 50, 3)).astype(np.float32)


def changed(image: np.ndarray, rows: slice, columns: slice, value) -> np.ndarray:
    image = image.copy()
    image[rows, columns] = value
    return image


def test_the_difference_of_8_bits_is_of_the_range():
    actual = changed(GREY, slice(20, 24), slice(33, 38), (128, 128, 128 + 51))
    difference = compare(actual, GREY, 2 / 255)
    assert difference.largest == pytest.approx(0.2)
    assert difference.ratio == pytest.approx(20 / 2000)
    assert difference.mean == pytest.approx(0.2 * 20 / 2000)
    assert difference.tile == (32, 16)
    assert difference.tile_flip > difference.flip > 0
    assert difference.heat[22, 35].astype(int).sum() > difference.heat[0, 0].astype(int).sum()


def test_a_difference_at_the_tolerance_passes_and_one_level_more_does_not():
    tolerance = Tolerance(flip=1, difference=2 / 255, ratio=0)
    assert compare(GREY + 2, GREY, tolerance.difference).passes(tolerance)
    assert compare(GREY - 2, GREY, tolerance.difference).passes(tolerance)
    assert not compare(GREY + 3, GREY, tolerance.difference).passes(tolerance)


def test_each_tolerance_can_fail_alone():
    difference = compare(changed(GREY, slice(0, 2), slice(0, 10), 255), GREY, 0.0)
    assert difference.passes(Tolerance(1, 0, 0.01))
    assert not difference.passes(Tolerance(1, 0, 0.0099))
    assert not difference.passes(Tolerance(difference.flip * 0.99, 0, 1))


def test_the_difference_of_floats_is_relative_and_has_a_floor():
    golden = np.ones((10, 10, 3), np.float32)
    golden[0, 0], golden[0, 1] = 102, 0  # mean 2
    actual = golden.copy()
    actual[0, 0] += 10.2
    assert compare(actual, golden, 0.05).largest == pytest.approx(0.1, rel=1e-5)
    actual = golden.copy()
    actual[0, 1] = 0.5
    assert compare(actual, golden, 0.05).largest == pytest.approx(0.25, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-6, 1e3])
def test_floats_of_any_unit_compare_alike(scale):
    actual = (RADIANCE * np.float32(1.03)) * np.float32(scale)
    difference = compare(actual, RADIANCE * np.float32(scale), 0.02)
    same = compare(RADIANCE * np.float32(1.03), RADIANCE, 0.02)
    assert difference.largest == pytest.approx(0.03, rel=1e-3)
    # Scaling rounds in the last bit, and the tone curve with it.
    assert difference.flip == pytest.approx(same.flip, rel=1e-3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_differs_from_all_but_itself(value):
    broken = changed(RADIANCE, slice(3, 4), slice(5, 6), value)
    assert compare(broken, broken.copy(), 0).largest == 0
    assert pixel_hash(broken) == pixel_hash(broken.copy())
    for pair in ((broken, RADIANCE), (RADIANCE, broken)):
        difference = compare(*pair, 1e6)
        assert difference.largest == np.inf
        assert difference.ratio == pytest.approx(1 / 2000)
        assert not difference.passes(Tolerance(1, 1e6, 1))


def test_flip_is_that_of_the_metrics():
    actual = np.roll(RADIANCE, 1, axis=1)
    expected = metrics.compare_linear(actual, RADIANCE, RADIANCE, RADIANCE).flip
    assert compare(actual, RADIANCE, 0).flip == pytest.approx(expected, rel=1e-6)
    assert compare(GREY + 9, GREY, 0).flip == pytest.approx(metrics.flip(shown(GREY + 9, GREY), shown(GREY, GREY)))


def test_the_hash_knows_type_and_shape():
    images = GREY, GREY + 1, GREY.reshape(50, 40, 3), GREY.astype(np.float32)
    assert len({pixel_hash(image) for image in images}) == 4


def test_images_of_one_channel_count_thrice():
    depth = RADIANCE[..., 0].astype(np.float64)
    assert as_image(depth).dtype == np.float32
    np.testing.assert_array_equal(as_image(depth)[..., 2], RADIANCE[..., 0])


@pytest.mark.parametrize("image", [GREY[..., :2], np.zeros((4, 4, 4), np.uint8), GREY.astype(int), GREY[:0], "a.png"])
def test_other_arrays_are_refused(image):
    with pytest.raises(UsageError, match="expected an image"):
        as_image(image)


@pytest.mark.parametrize(
    ("renderer", "version", "vendor", "family", "key"),
    [
        ("llvmpipe (LLVM 15.0.6)", "4.5 (Core Profile) Mesa 22.3.6", "Mesa/X.org", "llvmpipe", "llvmpipe-22.3"),
        ("softpipe", "3.3 (Core Profile) Mesa 24.0.1-1~22.04.2", "Mesa", "softpipe", "softpipe-24.0"),
        ("NVIDIA H200/PCIe/SSE2", "3.3.0 NVIDIA 550.54.14", "NVIDIA Corporation", "nvidia", "nvidia-550.54"),
        ("Mesa Intel(R) UHD (KBL)", "4.6 (Core Profile) Mesa 23.2.1", "Intel(R)", "intel", "intel-23.2"),
        ("AMD Radeon RX 6800 (navi21)", "4.6 (Core Profile) Mesa 23.1.0-devel", "AMD", "amd", "amd-23.1"),
        ("Apple M2", "4.1 Metal - 88", "Apple", "apple", "apple-4.1"),
        ("?", "", "", "unknown", "unknown"),
    ],
)  # fmt: skip
def test_drivers_have_names(renderer, version, vendor, family, key):
    driver = driver_of({"GL_RENDERER": renderer, "GL_VERSION": version, "GL_VENDOR": vendor})
    assert driver == (family, key)
    assert re.fullmatch(r"[a-z0-9.-]+", driver.key)  # it becomes part of a file's name


@pytest.mark.parametrize("name", ["", "a/b", "../a", "a@b", ".a", "a b", "ä"])
def test_a_name_that_no_file_can_have_is_refused(name):
    with pytest.raises(UsageError, match="expected a screenshot's name"):
        golden_of(Path("test_a.py"), name, ".png")


def test_unused_goldens_are_those_of_no_asked_name(tmp_path):
    a, b = tmp_path / "test_a.py", tmp_path / "test_b.py"
    for file in (a, b):
        file.touch()
    names = ["test_a/x.png", "test_a/x@llvmpipe.png", "test_a/x.exr", "test_a/y.v2@nvidia-550.54.png", "test_a/x.txt"]
    names += ["test_b/z.png", "test_gone/z.png"]
    for name in names:
        path = tmp_path / "screenshots" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    asked = {golden_of(a, "x", ".png")}

    def names_of(paths):
        return [path.relative_to(tmp_path / "screenshots").as_posix() for path in paths]

    assert names_of(unused([a], asked)) == ["test_a/x.exr", "test_a/y.v2@nvidia-550.54.png", "test_gone/z.png"]
    assert names_of(unused([a, b], asked | {golden_of(a, "y.v2", ".png"), golden_of(b, "z", ".png")})) == [
        "test_a/x.exr", "test_gone/z.png",
    ]  # fmt: skip
