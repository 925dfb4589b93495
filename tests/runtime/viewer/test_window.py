"""The viewer: its window under Xvfb, what it shows there, and how it ends."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scenes
import worlds
from frames import bake, full_scene, surface_bake
from repository import SCENES, TESTS
from viewer_script import STATUS

from gsgi.baker.cli import main
from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.camera import look_at
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend
from gsgi.runtime.gl.profile import PassCost
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import read_image
from gsgi.runtime.viewer.cost_table import cost_table
from gsgi.runtime.viewer.ellipsoids import Ellipsoids
from gsgi.runtime.viewer.overlay import Overlay, letters
from gsgi.runtime.viewer.picture import Picture

CORNELL = SCENES / "cornell.glb"
SIZE = 160, 120


@pytest.fixture(scope="module")
def bakes(tmp_path_factory) -> dict[str, Path]:
    """A rough bake of the Cornell box for each operator, and a world of two halves."""
    folder, points = tmp_path_factory.mktemp("bakes"), Triangles(read_gltf(CORNELL)).sample(400, 0)
    light = (0.5 + 0.5 * points.position / np.abs(points.position).max()).astype(np.float32)
    fine = from_surface(points.position, points.normal, light, 0)
    made = {"surface": Bake(fine, SurfaceBlend(), coarse=fine), "over": Bake(fine, OverBlend(near=0.01))}
    for name, baked in made.items():
        (folder / f"{name}.gsgi").write_bytes(codec.encode(baked))
    low, high = read_gltf(CORNELL).bounds()
    middle = np.array([(low[0] + high[0]) / 2, low[1], low[2]])
    halves = np.array([[low, [middle[0], *high[1:]]], [middle, high]], float)
    world = worlds.write(folder, [made["surface"]] * 2, halves, margin=0.02)
    return {name: folder / f"{name}.gsgi" for name in made} | {"world": world}


def gsgi_view(*arguments, script: str | None = None, **options) -> subprocess.CompletedProcess:
    start = [str(TESTS / script)] if script else ["-m", "gsgi.baker", "view"]
    command = [sys.executable, *start, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


@pytest.mark.parametrize("light", ["surface", "over", "world", None])
def test_a_window_shows_what_render_writes(display, bakes, light, tmp_path, gl, current_again):
    """A user's session (viewer_script.py), whose pictures are `gsgi render`'s, byte for byte."""
    gi = ["--gi", str(bakes[light])] if light else []
    run = gsgi_view(CORNELL, *gi, "--size", "160x120", script="viewer_script.py", env=display, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    shown = {view: np.array(image) for view, image in json.loads(run.stdout).items()}
    layers = ["final", "primary", *(["indirect"] if light else [])]
    assert list(shown) == layers
    for number, layer in enumerate(layers, 1):
        picture = tmp_path / f"cornell-{number:03}.png"
        assert main.run(["render", str(CORNELL), *gi, "-o", str(tmp_path / "r.png"), "--size", "160x120",
                        "--layer", layer]) == 0  # fmt: skip
        assert picture.read_bytes() == (tmp_path / "r.png").read_bytes(), layer
        assert f"wrote {picture.name}" in run.stderr
        difference = np.abs(255 * read_image(picture) - shown[layer])[STATUS:]
        assert difference.max() <= 1.01, layer  # the driver's rounding
    assert main.run(["render", str(CORNELL), *gi, "-o", str(tmp_path / "r.png"), "--size", "200x90"]) == 0
    ellipsoids = light in ("surface", "over")
    assert ("in many files" in run.stderr) == (light == "world")
    last = tmp_path / f"cornell-{len(layers) + ellipsoids + 1:03}.png"
    assert last.read_bytes() == (tmp_path / "r.png").read_bytes()
    assert not (tmp_path / f"cornell-{len(layers) + ellipsoids + 2:03}.png").exists()
    assert "Esc           quit" in run.stderr
    pressed, leaving = (line for line in run.stderr.splitlines() if line.startswith("--eye "))
    assert pressed == leaving == run.stderr.splitlines()[-1]
    assert ("no baked light to show" in run.stderr) == (light is None)


def test_pictures_are_never_written_over(display, tmp_path):
    (tmp_path / "cornell-001.png").write_text("mine")
    run = gsgi_view(CORNELL, "--size", "160x120", script="viewer_script.py", env=display, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "cornell-001.png").read_text() == "mine"
    assert (tmp_path / "cornell-002.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([CORNELL], 5, "no window"),
        (["missing.glb"], 2, "missing.glb: cannot read"),
        ([CORNELL, "--gi", CORNELL], 3, "cornell.glb: "),
        ([CORNELL, "--camera", "roof"], 1, "'roof'"),
        ([CORNELL, "--size", "0x0"], 1, "--size"),
    ],
)
def test_what_is_wrong_takes_one_line(no_display, arguments, code, words):
    run = gsgi_view(*arguments, env=no_display)
    assert run.returncode == code
    line = run.stderr.splitlines()[-1]
    assert line.startswith("gsgi: ")
    assert words in line
    assert code == 1 or run.stderr.count("\n") == 1


def test_without_moderngl_window_it_says_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "moderngl_window.context.pyglet.window", None)
    assert main.run(["view", str(CORNELL)]) == 5
    error = capsys.readouterr().err
    assert "is not installed: install gsgi with its extra 'view'" in error
    assert error.count("\n") == 1


def test_nothing_else_loads_moderngl_window():
    code = (
        "import sys; import gsgi.runtime.gl.renderer, gsgi.baker.cli.commands, gsgi.runtime.viewer.window;"
        "assert not {'moderngl_window', 'pyglet'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("baked", [surface_bake, bake])
def test_a_resized_renderer_draws_as_one_of_that_size(gl, baked):
    """Another resolution of the Gaussians as well."""
    first = DeferredRenderer(gl, full_scene(), baked(), 33, 50)
    first.render(scenes.inside_camera())
    first.resize(*SIZE)
    first.set_splat_scale(2)
    second = DeferredRenderer(gl, full_scene(), baked(), *SIZE, splat_scale=2)
    for renderer in (first, second):
        renderer.render(scenes.inside_camera())
    for layer in ("final", "primary", "indirect", "depth"):
        assert np.array_equal(first.read(layer), second.read(layer)), layer
    first.release()
    second.release()


def one_gaussian(scale, color=(1.0, 2.0, 3.0), position=(0.0, 0.0, 0.0)) -> Bake:
    arrays = {"position": [position], "rotation": [[0, 0, 0, 1]], "scale": [scale], "opacity": [0.5]}
    arrays |= {"sh": [[np.array(color) / constants.SH_C0]]}
    return Bake(Gaussians(**{k: np.asarray(v, np.float32) for k, v in arrays.items()}), OverBlend(near=0.01))


def drawn(gl, baked: Bake, camera) -> np.ndarray:
    picture = Picture(gl, scenes.furnace(), baked, SIZE)
    picture.render(camera, "ellipsoids")
    image = picture.read()
    picture.release()
    return image


@pytest.mark.parametrize("away", [(0.0, 0.0, 0.0), (1e5, 0.0, -1e5)], ids=["origin", "far"])
def test_an_ellipsoid_covers_its_outline(gl, away):
    """A sphere of radius r at distance d covers a disc of half-angle asin(r / d); its middle has its colour."""
    away = np.array(away)
    camera = look_at(away + np.array([0, 0, 4.0]), away, np.array([0.0, 1.0, 0.0]), 0.8, 0.01)
    image = drawn(gl, one_gaussian([1.0, 1.0, 1.0], position=away), camera)
    focal = SIZE[1] / (2 * np.tan(0.4))
    radius = focal * np.tan(np.arcsin(1 / 4))
    assert (image.max(axis=2) > 0).sum() == pytest.approx(np.pi * radius**2, rel=0.02)
    assert image[60, 80] == pytest.approx([1, 2, 3], rel=0.01)
    edge = image[60, int(80 + radius - 1)]
    assert edge[0] < 0.6


def test_a_needle_and_a_disc_have_their_own_shapes(gl):
    camera = look_at(np.array([0, 0, 4.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.8, 0.01)
    image = drawn(gl, one_gaussian([1.0, 0.1, 0.0]), camera).max(axis=2) > 0
    rows, columns = np.flatnonzero(image.any(axis=1)), np.flatnonzero(image.any(axis=0))
    focal = SIZE[1] / (2 * np.tan(0.4))
    assert len(columns) == pytest.approx(2 * focal / 4, abs=3)
    assert len(rows) == pytest.approx(0.2 * focal / 4, abs=3)


def test_the_nearer_ellipsoid_hides_the_other(gl):
    near, far = one_gaussian([0.5] * 3, (1, 0, 0), (0, 0, 1)), one_gaussian([1.0] * 3, (0, 1, 0), (0, 0, -1))
    pairs = zip(vars(near.gaussians).items(), vars(far.gaussians).items(), strict=True)
    both = {name: (np.concatenate([a, b]), np.concatenate([b, a])) for (name, a), (_, b) in pairs}
    camera = look_at(np.array([0, 0, 4.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.8, 0.01)
    for order in (0, 1):
        gaussians = Gaussians(**{name: arrays[order] for name, arrays in both.items()})
        image = drawn(gl, Bake(gaussians, OverBlend(near=0.01)), camera)
        assert image[60, 80, 0] > 0.9
        assert image[60, 80, 1] == 0


@pytest.mark.parametrize("baked", [surface_bake, bake])
def test_an_eye_among_gaussians_sees_finite_light(gl, baked):
    ellipsoids = Ellipsoids(gl, baked(), SIZE)
    ellipsoids.draw(scenes.inside_camera())
    light = np.frombuffer(ellipsoids.radiance.read(), np.float16)
    assert np.isfinite(light).all()
    assert light.any()
    ellipsoids.release()


def test_letters_are_in_the_upper_left_corner(gl):
    target, overlay = gl.framebuffer(gl.texture((160, 120), 4)), Overlay(gl)
    target.use()
    target.clear(0.5, 0.5, 0.5, 1)
    overlay.draw(target, (160, 120))
    overlay.write("ms")
    overlay.draw(target, (160, 120))
    image = np.frombuffer(target.read(components=3), np.uint8).reshape(120, 160, 3)[::-1, :, 0]
    expected = letters("ms").repeat(2, axis=0).repeat(2, axis=1)[..., 0]
    height, width = expected.shape
    assert np.array_equal(image[:height, :width] == 255, expected == 255)
    assert (image[:height, :width] < 255).any()
    assert (image[height:] == 128).all()
    assert (image[:, width:] == 128).all()
    overlay.write("")
    overlay.draw(target, (160, 120))
    overlay.release()


def test_costs_leave_the_picture_visible(gl):
    """In a window of 640 x 480 px, with the passes of the surface operator under the status line."""
    names = "frame/gbuffer", "frame/shadow", "frame/primary", "surface/points", "surface/read"
    names += ("frame/composite",)
    table = cost_table([[PassCost(name, 100.0, 100.0) for name in names]])
    target, overlay = gl.framebuffer(gl.texture((640, 480), 4)), Overlay(gl)
    target.use()
    target.clear(0.5, 0.5, 0.5, 1)
    overlay.write(f"final, exposure 0.123, Gaussians at 1/2 resolution\n\n{table}")
    overlay.draw(target, (640, 480))
    hidden = np.frombuffer(target.read(components=1), np.uint8) != 128
    assert 0.05 < hidden.mean() < 0.25
    overlay.release()


def test_costs_are_means_and_sums():
    frames = [[PassCost("frame/gbuffer", 1.0, 2.0), PassCost("over/splat", 3.0, 0.5)],
              [PassCost("frame/gbuffer", 2.0, 2.0), PassCost("over/splat", 5.0, 1.5)]]  # fmt: skip
    assert [line.split() for line in cost_table(frames).splitlines()] == [
        ["pass", "gpu", "ms", "cpu", "ms"],
        ["frame/gbuffer", "1.50", "2.00"],
        ["over/splat", "4.00", "1.00"],
        ["all", "5.50", "3.00"],
    ]
    assert cost_table([]) == ""
