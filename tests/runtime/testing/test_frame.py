"""The frame that the fixture `gsgi_render` draws, from records and from files."""

import shutil

import numpy as np
import oracle
import pytest
import scenes
from repository import SCENES

from gsgi.runtime.display import to_uint8, tone_map
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.scene import Scene

CORNELL = SCENES / "cornell.glb"
SIZE = (32, 24)


def test_a_file_and_its_scene_give_the_same_frame(gsgi_render):
    frame = gsgi_render(CORNELL, "front", SIZE)
    assert (frame.shape, frame.dtype) == ((24, 32, 3), np.uint8)
    scene = read_gltf(CORNELL)
    np.testing.assert_array_equal(gsgi_render(scene, scene.cameras["front"], SIZE), frame)
    assert (gsgi_render(str(CORNELL), "corner", SIZE) != frame).any()


def test_without_a_camera_it_is_the_first(gsgi_render):
    first = next(iter(read_gltf(CORNELL).cameras))
    np.testing.assert_array_equal(gsgi_render(CORNELL, size=SIZE), gsgi_render(CORNELL, first, SIZE))


def test_a_layer_is_linear_and_the_exposure_is_fixed(gsgi_render):
    assert gsgi_render(CORNELL, size=SIZE, layer="depth").shape == (24, 32)
    for layer in set(LAYERS) - {"depth"}:
        assert gsgi_render(CORNELL, size=SIZE, layer=layer).shape == (24, 32, 3), layer
    final = gsgi_render(CORNELL, size=SIZE, layer="final")
    assert final.dtype == np.float32
    for exposure in (1.0, 3.0):
        shown = gsgi_render(CORNELL, size=SIZE, exposure=exposure)
        # The shader rounds to 8 bits in its own way.
        assert np.abs(shown.astype(int) - to_uint8(tone_map(final, exposure))).max() <= 1


def test_a_bake_adds_its_light(gsgi_render, tmp_path):
    bake = Bake(oracle.random_gaussians(200, 0, 1), SurfaceBlend(), coarse=oracle.random_gaussians(20, 2, 2))
    (tmp_path / "a.gsgi").write_bytes(codec.encode(bake))
    scene = scenes.furnace()
    baked = gsgi_render(scene, size=SIZE, bake=tmp_path / "a.gsgi", layer="indirect")
    assert baked.any()
    decoded = codec.decode((tmp_path / "a.gsgi").read_bytes())
    np.testing.assert_array_equal(gsgi_render(scene, size=SIZE, bake=decoded, layer="indirect"), baked)
    assert not gsgi_render(scene, size=SIZE, layer="indirect").any()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"layer": "light"}, "^layer: expected one of final, primary, .*, got 'light'$"),
        ({"exposure": float("nan")}, "^exposure: expected a number above 0, got nan$"),
        ({"exposure": -1}, "^exposure: "),
        ({"size": 160}, "^size: expected width and height in px, got 160$"),
        ({"size": (0, 120)}, "^size: "),
    ],
)
def test_what_cannot_be_drawn_is_named(gsgi_render, wrong, message):
    with pytest.raises(UsageError, match=message):
        gsgi_render(CORNELL, **wrong)


def test_a_scene_file_comes_with_the_light_beside_it(gsgi_render, tmp_path):
    shutil.copy(CORNELL, tmp_path / "room.glb")
    before = gsgi_render(tmp_path / "room.glb", "front", SIZE, layer="final")
    (tmp_path / "room.lights.toml").write_text("light_scale = 2.0\n")
    after = gsgi_render(tmp_path / "room.glb", "front", SIZE, layer="final")
    np.testing.assert_allclose(after, 2 * before, rtol=2e-3)  # half floats


@pytest.mark.parametrize("name", ["nowhere", ""])
def test_a_camera_that_the_scene_lacks_is_refused(gsgi_render, name):
    with pytest.raises(UsageError, match=r"'front'.*'corner'.*got "):
        gsgi_render(CORNELL, name, SIZE)


def test_a_scene_without_cameras_says_so(gsgi_render):
    with pytest.raises(UsageError, match=r"\(none\), got None"):
        gsgi_render(Scene(tuple(scenes.box()), (scenes.WHITE,)), size=SIZE)
