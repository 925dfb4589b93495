"""Layers as image files."""

import numpy as np
import pytest

from gsgi.baker.evaluation.pictures import BAND, write_layer
from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.image import read_image


def written(path, layer: str, values: np.ndarray, exposure: float | None = None) -> np.ndarray:
    write_layer(str(path / "x.png"), layer, values, exposure)
    return np.round(255 * read_image(path / "x.png")).astype(np.uint8)


@pytest.mark.parametrize("exposure", [None, 2.0])
def test_a_picture_of_several_bands_has_one_exposure(tmp_path, exposure):
    light = np.random.default_rng(0).gamma(0.5, size=(2 * BAND + 3, 5, 3)).astype(np.float32)
    expected = to_uint8(tone_map(light, exposure or auto_exposure(light)))
    assert np.array_equal(written(tmp_path, "final", light, exposure), expected)


def test_depth_is_relative_to_the_largest_of_all_bands(tmp_path):
    depth = np.linspace(0, 7, BAND + 9, dtype=np.float32)[:, None].repeat(4, axis=1)
    image = written(tmp_path, "depth", depth)
    assert np.array_equal(image[:, 0, 0], to_uint8(depth[:, 0] / 7))
    assert not written(tmp_path, "depth", np.zeros((3, 4), np.float32)).any()
