"""What the options of a command stand for."""

from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from gltf_files import quad_scene, write

from gsgi.baker.cli.console import Console
from gsgi.baker.cli.inputs import WARNINGS, choose_camera, read_scene
from gsgi.baker.progress import Progress
from gsgi.runtime.errors import UsageError
from gsgi.runtime.scene import Scene


def test_the_placed_camera_frames_an_object_in_the_open():
    scene = Scene(tuple(scenes.box(1.0, inward=False)), (scenes.WHITE,))
    options = SimpleNamespace(camera=None, size=(128, 128))
    camera = choose_camera(scene, options)
    corners = np.concatenate([mesh.position for mesh in scene.meshes])
    local = (corners - camera.position) @ camera.world_from_view[:3, :3]
    across = np.abs(local[:, :2]) / (-local[:, 2:] * np.tan(camera.yfov / 2))
    assert (local[:, 2] < 0).all()
    assert (across < 1).all(axis=1).mean() > 0.8


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
    options = SimpleNamespace(camera="x", scene="room.glb")
    with pytest.raises(UsageError) as raised:
        choose_camera(Scene((), (), cameras=cameras), options)
    assert str(raised.value).isprintable()
    assert "Küche" in str(raised.value)
