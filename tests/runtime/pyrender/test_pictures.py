"""The drop-in beside pyrender: the same images of the same scenes."""

import subprocess
import sys

import numpy as np
import pyrender_scenes
import pytest
from pyrender_scenes import CASES, SIZE, draw

from gsgi.runtime.pyrender import OffscreenRenderer, RenderFlags

pytestmark = pytest.mark.usefixtures("pyrender", "current_again")


@pytest.fixture(scope="module")
def theirs(pyrender, gl, tmp_path_factory):
    """What pyrender draws, by "case/kind"."""
    path = tmp_path_factory.mktemp("pyrender") / "images.npz"
    child = subprocess.run([sys.executable, pyrender_scenes.__file__, path], capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    return np.load(path)


@pytest.fixture(scope="module")
def renderer(gl):
    result = OffscreenRenderer(*SIZE)
    gl.__enter__()
    yield result
    result.delete()
    gl.__enter__()


@pytest.mark.parametrize("name", CASES)
def test_color_and_depth_are_those_of_pyrender(renderer, theirs, name):
    for kind, image in draw(renderer, name).items():
        expected = theirs[f"{name}/{kind}"]
        assert (image.shape, image.dtype) == (expected.shape, expected.dtype)
        assert image.flags.writeable
        if kind == "color":
            # The same arithmetic on the same driver (llvmpipe: the same bits). Elsewhere a rounding may fall the other
            # way, and at an edge take a sample with it: a quarter of the contrast, in few pixels.
            off = np.abs(image.astype(int) - expected)
            assert off.mean() < 0.02, off.mean()
            assert (off > 1).mean() < 1e-3, (off > 1).mean()
        elif name != "camera_orthographic":
            # Both linearise the same 24 bits, pyrender in single precision.
            assert np.array_equal(image == 0, expected == 0)
            assert np.allclose(image, expected, rtol=2e-5)


def test_cases_draw_something(theirs):
    empty = theirs["nothing/color"]
    colored = [name for name, (_, flags) in CASES.items() if not flags & RenderFlags.DEPTH_ONLY]
    for name in set(colored) - {"nothing", "culled"}:
        color = theirs[f"{name}/color"]
        assert (color[..., :3] != empty[..., :3]).any(axis=-1).mean() > 0.01, name


def test_orthographic_depth_is_in_metres(pyrender, renderer):
    scene = pyrender.Scene()
    scene.add(pyrender_scenes.quad(), pose=pyrender_scenes.translation(0, 0, -2.5))
    scene.add(pyrender.OrthographicCamera(1.0, 1.0, znear=0.1, zfar=10.0))
    depth = renderer.render(scene, RenderFlags.DEPTH_ONLY)
    # 24 bits over 9.9 m
    assert depth[SIZE[1] // 2, SIZE[0] // 2] == pytest.approx(2.5, abs=2e-6)
    assert depth[0, 0] == 0


def test_flags_are_pyrenders(pyrender):
    theirs = {name: value for name, value in vars(pyrender.RenderFlags).items() if not name.startswith("_")}
    assert theirs == {name: int(flag) for name, flag in RenderFlags.__members__.items()}


def test_points_have_their_size(pyrender, renderer):
    scene = pyrender.Scene(bg_color=(0, 0, 0))
    scene.add(pyrender.Mesh.from_points([[0, 0, -1]], colors=[[1.0, 1, 1]]))
    scene.add(pyrender.PerspectiveCamera(1.0))
    renderer.point_size = 6
    covered = renderer.render(scene, RenderFlags.FLAT)[0].any(axis=-1).sum()
    renderer.point_size = 1
    assert covered == 36
