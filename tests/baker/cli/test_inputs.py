"""What the options of a command stand for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from gltf_files import quad_scene, write

from gsgi.baker.cli import main
from gsgi.baker.cli.console import Console
from gsgi.baker.cli.inputs import WARNINGS, choose_camera, read_scene
from gsgi.baker.progress import Progress
from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.scene import Scene
from gsgi.runtime.viewer.fly_camera import FlyCamera

HERE = dict.fromkeys(("camera", "eye", "target", "fov"))


def chosen(scene: Scene, *flags: str) -> Camera:
    """The camera of `gsgi render` with these flags."""
    return choose_camera(scene, main.parser().parse_args(["render", "room.glb", "-o", "room.png", *flags]))


def room(**changes) -> Scene:
    return Scene(tuple(scenes.box()), (scenes.WHITE,), **changes)


def test_a_camera_stands_where_it_is_told_to():
    camera = chosen(room(), "--eye", "-0.5,0.25,.5", "--target", "-0.5,1.25,-0.5", "--fov", "50")
    assert camera.position == pytest.approx([-0.5, 0.25, 0.5])
    assert -camera.world_from_view[:3, 2] == pytest.approx(np.array([0, 1, -1]) / np.sqrt(2))
    assert camera.world_from_view[1, 0] == 0  # its horizon is level
    assert np.degrees(camera.yfov) == pytest.approx(50)
    assert 0 < camera.znear < 0.01 * room().diagonal()


@pytest.mark.parametrize(("target", "top"), [("0,-9,0", (0, 0, -1)), ("0,9,0", (0, 0, 1)), ("1e-9,9,0", (0, 0, 1))])
def test_looking_straight_up_or_down(target, top):
    camera = chosen(room(), "--eye", "0,0,0", "--target", target)
    assert camera.world_from_view[:3, 1] == pytest.approx(top, abs=1e-6)
    assert np.linalg.det(camera.world_from_view[:3, :3]) == pytest.approx(1)


def test_the_field_of_view_of_any_camera():
    own = scenes.inside_camera()
    camera = chosen(room(cameras={"own": own}), "--fov", "20")
    assert np.degrees(camera.yfov) == pytest.approx(20)
    assert np.array_equal(camera.world_from_view, own.world_from_view)


def test_the_flags_that_the_viewer_prints_lead_back_to_where_it_was():
    for scale, away in ((1.0, 0.0), (1e-3, 0.0), (30.0, 1e4)):
        eye = scale * np.array([-0.3, 0.2, 0.4]) + away
        seen = look_at(eye, eye + np.array([1, -0.5, -2]), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
        flags = FlyCamera(seen, scale * room().diagonal()).flags()
        camera = chosen(room(), *flags.split())
        assert np.abs(camera.position - eye).max() < 1e-4 * scale
        assert camera.world_from_view[:3, :3] == pytest.approx(seen.world_from_view[:3, :3], abs=1e-4)
        assert camera.yfov == pytest.approx(seen.yfov, rel=1e-5)


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("--eye 0,0,0", "--eye and --target need each other"),
        ("--target 0,0,0", "--eye and --target need each other"),
        ("--eye 1,2,3 --target 1,2,3", "--target: expected a point other than --eye"),
        ("--eye 0,0,0 --target 0,0,1 --camera own", "--camera and --eye exclude each other"),
    ],
)
def test_flags_of_a_camera_that_make_no_sense(flags, told):
    with pytest.raises(UsageError, match=told):
        chosen(room(cameras={"own": scenes.inside_camera()}), *flags.split())


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("--eye 0,0", "argument --eye: expected X,Y,Z, such as 0,1.6,3, at most 1e+09 m, got '0,0'"),
        ("--eye 0,inf,0", "argument --eye: expected X,Y,Z"),
        ("--target 1e300,0,0", "argument --target: expected X,Y,Z"),
        ("--fov 0", "argument --fov: expected a number from 1 to 170, got '0'"),
        ("--fov wide", "argument --fov: expected a number from 1 to 170, got 'wide'"),
    ],
)
def test_a_wrong_value_takes_one_line(capsys, flags, told):
    with pytest.raises(SystemExit):
        chosen(room(), *flags.split())
    line = capsys.readouterr().err
    assert line.startswith(f"gsgi: {told}")
    assert line.endswith("(see gsgi render --help)\n")
    assert line.count("\n") == 1


def test_the_placed_camera_frames_an_object_in_the_open():
    scene = Scene(tuple(scenes.box(1.0, inward=False)), (scenes.WHITE,))
    options = SimpleNamespace(**HERE, size=(128, 128))
    camera = choose_camera(scene, options)
    corners = np.concatenate([mesh.position for mesh in scene.meshes])
    local = (corners - camera.position) @ camera.world_from_view[:3, :3]
    across = np.abs(local[:, :2]) / (-local[:, 2:] * np.tan(camera.yfov / 2))
    assert (local[:, 2] < 0).all()
    assert (across < 1).all(axis=1).mean() > 0.8


def test_where_no_camera_can_be_placed_the_scene_is_named():
    (box, *_) = scenes.box()
    scene = Scene((replace(box, position=1e37 * box.position),), (scenes.WHITE,))
    with pytest.raises(SceneError, match=r"^room\.glb: the scene is .* m across"):
        chosen(scene)


def test_many_warnings_of_one_kind_are_counted(tmp_path, capsys):
    document, data = quad_scene()
    document["materials"] = [{"name": f"glass {i}", "alphaMode": "BLEND"} for i in range(40)]
    (mesh,) = document["meshes"]
    (primitive,) = mesh["primitives"]
    mesh["primitives"] = [primitive | {"material": i} for i in range(40)]
    path = str(write(tmp_path / "a.glb", document, data))
    light = dict.fromkeys(("lights", "env", "env_rotation", "env_scale", "sun", "sun_irradiance", "sun_color"))
    options = SimpleNamespace(scene=path, limit=None, transparent="cutout", light_scale=None, **light)
    scene = read_scene(options, Progress(Console()))
    lines = [line for line in capsys.readouterr().err.splitlines() if "alphaMode" in line]
    assert sum("is blended" in warning for warning in scene.warnings) == 40
    assert len(lines) == WARNINGS + 1
    assert lines[-1].endswith(f"/materials/*/alphaMode: {40 - WARNINGS} more like these: `gsgi validate` lists them")


def test_camera_names_of_a_file_stay_on_one_line():
    cameras = dict.fromkeys(("Küche", "a\nb", "\x1b[31m"), scenes.inside_camera())
    options = SimpleNamespace(**HERE | {"camera": "x"}, scene="room.glb")
    with pytest.raises(UsageError) as raised:
        choose_camera(Scene((), (), cameras=cameras), options)
    assert str(raised.value).isprintable()
    assert "Küche" in str(raised.value)
