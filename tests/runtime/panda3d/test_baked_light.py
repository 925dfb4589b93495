"""Baked light in Panda3D against our own frames of the same cameras."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gsgi_files import constant
from repository import ROOT, SAMPLES
from surface_cases import grouped, with_relief

import gsgi
from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer

pytest.importorskip("panda3d", reason="the extra `panda3d` is not installed")
pytest.importorskip("gltf", reason="the extra `panda3d` is not installed")
from panda3d_frames import BACK, FOV_Y, LARGER, SCALES, SCENE, SIZE, TEXEL, WIDTH

HALF = 0.5
# The oldest context that Panda3D asks for, and one of the core profile.
CONFIGS = {"compatibility": "", "core": "gl-version 3 3"}


def cornell_bake() -> Bake:
    points = Triangles(gsgi.read_scene(SCENE)).sample(1500, 0)
    light = (0.5 + 0.4 * np.sin(9 * points.position)).astype(np.float32)
    fine = from_surface(points.position, points.normal, light, 0)
    return grouped(
        Bake(fine, SurfaceBlend(), coarse=from_surface(points.position[:9], points.normal[:9], light[:9], 0))
    )


BAKE = cornell_bake()
BUMPY = with_relief(replace(BAKE, groups=()))


def run_frames(folder: Path, config: str, **environment: str) -> subprocess.CompletedProcess:
    """Run panda3d_frames.py with files in `folder`."""
    files = {"cornell": BAKE, "half": constant([HALF] * 3), "over": constant([HALF] * 3, "over"), "bumpy": BUMPY}
    for name, bake in files.items():
        (folder / name).write_bytes(codec.encode(bake))
    script = ROOT / "tests" / "panda3d_frames.py"
    command = [sys.executable, script, *(folder / name for name in files), folder / "out.npz", config]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)


@pytest.fixture(scope="module", params=CONFIGS.values(), ids=CONFIGS)
def drawn(request, tmp_path_factory) -> dict:
    """Arrays and messages of panda3d_frames.py."""
    folder = tmp_path_factory.mktemp("panda3d")
    run = run_frames(folder, request.param)
    assert run.returncode == 0, run.stderr
    return dict(np.load(folder / "out.npz"))


def ours(gl, size: tuple[int, int], weights: dict | None = None) -> np.ndarray:
    """albedo * B of our own renderer."""
    scene = gsgi.read_scene(SCENE)
    bake = codec.decode(codec.encode(BAKE))
    renderer = DeferredRenderer(gl, scene, bake, *size, splat_scale=1)
    renderer.weights = weights or {}
    renderer.render(scene.cameras["front"])
    light = renderer.read("indirect") * renderer.read("albedo")
    renderer.release()
    return light


def check(found: np.ndarray, expected: np.ndarray) -> None:
    """The same but for outlines, where a pixel shows another surface."""
    error = np.abs(found - expected).max(axis=-1)
    assert found.shape == expected.shape
    assert expected.mean() > 0.1
    assert (error > 2e-3).mean() < 0.01
    assert error.mean() < 2e-3


def test_the_light_is_that_of_our_frame(gl, drawn):
    check(drawn["plain"], ours(gl, SIZE))


def test_light_groups_have_weights(gl, drawn):
    np.testing.assert_array_equal(drawn["whole again"], drawn["plain"])
    check(drawn["weighed"], ours(gl, SIZE, {"lamps": 0.25, "sky": (1, 0.5, 2)}))
    assert np.abs(drawn["weighed"] - drawn["plain"]).max() > 0.1


def test_a_scene_with_the_axes_of_gltf(gl, drawn):
    check(drawn["own reader"], ours(gl, SIZE))


def test_the_light_moves_with_its_scene(gl, drawn):
    check(drawn["moved"], ours(gl, SIZE))


def test_the_scale_is_one_of_radiance(drawn):
    np.testing.assert_allclose(drawn["scaled"], 2 * drawn["plain"], atol=2e-3)


def test_the_light_follows_the_size_of_the_frame(gl, drawn):
    check(drawn["resized"], ours(gl, LARGER))


def test_each_display_region_has_light(gl, drawn):
    half = ours(gl, (SIZE[0] // 2, SIZE[1]))
    check(drawn["halves"], np.hstack([half, half]))


def test_an_orthographic_lens(drawn):
    """The back wall, where nothing stands before it."""
    (width, height), pixel = SIZE, WIDTH / SIZE[0]
    x, y = (np.arange(width) + 0.5 - width / 2) * pixel, 0.273 - (np.arange(5) + 0.5 - height / 2) * pixel
    x, y = np.meshgrid(x, y)
    position = np.stack([x, y, np.full_like(x, -0.5592)], axis=-1).reshape(-1, 3)
    scene = gsgi.read_scene(SCENE)
    wall = next(mesh for mesh in scene.meshes if mesh.position[:, 2].max() < -0.55)
    normal = np.tile([0.0, 0.0, 1.0], (len(position), 1))
    expected = gsgi.sample(codec.decode(codec.encode(BAKE)), position, normal)
    expected = expected.reshape(5, width, 3) * scene.materials[wall.material].base_color[:3]
    inside = np.abs(x[0]) < 0.27
    assert inside.mean() > 0.9
    np.testing.assert_allclose(drawn["orthographic"][:5, inside], expected[:, inside], atol=2e-3)


@pytest.mark.parametrize(("name", "side"), [("bumpy", 1), ("bumpy behind", -1)])
def test_light_follows_normal_maps(drawn, name, side):
    """The square on the back wall, and turned round: then the normal is flipped to the side that is seen."""
    (width, height), bake = SIZE, codec.decode(codec.encode(BUMPY))
    step = 2 * np.tan(np.radians(FOV_Y / 2)) * (BACK + 0.8) / height
    x, y = np.meshgrid((np.arange(width) + 0.5 - width / 2) * step, (height / 2 - np.arange(height) - 0.5) * step)
    position = np.stack([x, y + 0.273, np.full_like(x, -BACK)], axis=-1).reshape(-1, 3)
    bent = (np.array(TEXEL) / 127.5 - 1) * [1, side, 1]
    plane, mapped = (np.broadcast_to(np.float32(n), position.shape) for n in ([0, 0, 1], bent))
    light, flat = (gsgi.sample(bake, position, plane, mapped=n).reshape(height, width, 3) for n in (mapped, plane))
    inside = (np.abs(x) < 0.18) & (y > 0.1) & (y < 0.18)  # above the blocks
    assert np.abs(light - flat)[inside].mean() > 0.05
    np.testing.assert_allclose(drawn[name][inside], light[inside], rtol=2e-3, atol=2e-3)


def test_what_is_blended_has_light_and_dims_what_is_behind(drawn):
    height, width = drawn["pane"].shape[:2]
    middle = slice(height // 2 - 8, height // 2 + 8), slice(width // 2 - 8, width // 2 + 8)
    np.testing.assert_allclose(drawn["pane"][middle], HALF, atol=1e-3)
    glass = 0.25 * HALF + 0.75 * drawn["bare"][middle]
    assert np.abs(drawn["bare"][middle] - HALF).min() > 0.02
    np.testing.assert_allclose(drawn["glass"][middle], glass, atol=2e-3)
    assert np.abs(drawn["off"][middle]).max() < 1e-3  # as opaque as before, without light


def test_the_albedo_is_that_of_the_material(drawn):
    height, width = drawn["coloured"].shape[:2]
    np.testing.assert_allclose(drawn["coloured"][height // 2, width // 2], [HALF * 0.5, 0, HALF * 0.1], atol=2e-3)


def test_mistakes_are_named(drawn):
    assert str(drawn["display values"]).startswith("UnsupportedError: camera: host holds display values")
    assert str(drawn["no camera"]).startswith("ValueError: camera: ")
    assert "operator" in str(drawn["over"])
    assert str(drawn["axes"]).startswith("ValueError: scene: ")
    assert str(drawn["no scene"]).startswith("ValueError: scene: ")
    for scale, found in zip(SCALES, drawn["scales"], strict=True):
        assert str(found) == f"ValueError: scale: expected a number from 0 on, got {scale!r}"


def test_a_room_may_be_removed_before_its_light(drawn):
    np.testing.assert_array_equal(drawn["room removed"], drawn["light removed"])
    assert drawn["room removed"].max() > 0
    assert drawn["tasks"].tolist() == [0, 1, 0]


def test_an_old_driver_is_named(tmp_path):
    old = {"MESA_GL_VERSION_OVERRIDE": "2.1", "MESA_GLSL_VERSION_OVERRIDE": "120"}
    assert "UnsupportedError: baked light needs GLSL 3.30, " in run_frames(tmp_path, "", **old).stderr


def test_the_sample_draws_both_pictures(tmp_path):
    from PIL import Image

    (tmp_path / "half.gsgi").write_bytes(codec.encode(constant([0.1] * 3)))
    sample = SAMPLES / "07_panda3d.py"
    command = [sys.executable, sample, tmp_path / "half.gsgi", tmp_path / "both.png"]
    subprocess.run(command, check=True, capture_output=True)
    both = np.asarray(Image.open(tmp_path / "both.png")).astype(int)
    without, lit = both[:, :320], both[:, 320:]
    assert both.shape == (320, 640, 3)
    assert (lit >= without).all()
    assert without[20, 160].max() < 10  # the ceiling, which the lamp does not reach
    assert lit[20, 160].min() > 60
    assert len(sample.read_text(encoding="utf-8").splitlines()) <= 60
