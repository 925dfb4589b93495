"""Camera paths: the file, and each way in which it can be wrong."""

import json

import numpy as np
import pytest

from gsgi.baker.views.camera_path import read_camera_path
from gsgi.baker.views.placement import YFOV
from gsgi.runtime.errors import FileError, SceneError

GOOD = {"position": [1, 2, 3], "target": [1, 2, -5]}


def write(folder, *cameras) -> str:
    path = folder / "path.json"
    path.write_text(json.dumps({"cameras": cameras}))
    return str(path)


def test_cameras_stand_and_look_as_the_file_says(tmp_path):
    path = write(tmp_path, GOOD, {**GOOD, "up": [2, 0, 0], "yfov": 0.7})
    first, second = read_camera_path(path, diagonal=10.0).values()
    np.testing.assert_allclose(first.position, [1, 2, 3])
    np.testing.assert_allclose(first.world_from_view[:3, :3], np.eye(3), atol=1e-12)
    assert first.yfov == YFOV
    np.testing.assert_allclose(second.world_from_view[:3, 1], [1, 0, 0], atol=1e-12)
    assert second.yfov == 0.7
    assert list(read_camera_path(path, 10.0)) == ["path 1", "path 2"]


def test_the_length_of_the_line_of_sight_does_not_matter(tmp_path):
    path = write(tmp_path, {**GOOD, "target": [1, 2, -1e200]}, {"position": [0, 0, 0], "target": [0, 0, -1e-200]})
    for camera in read_camera_path(path, 1.0).values():
        np.testing.assert_allclose(camera.world_from_view[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("camera", "pointer"),
    [
        ({"position": [1, 2, 3]}, "/cameras/0"),
        ({**GOOD, "position": [1, 2]}, "/cameras/0/position"),
        ({**GOOD, "position": [1, 2, "3"]}, "/cameras/0/position/2"),
        ({**GOOD, "target": [1, 2, 3]}, "/cameras/0/target"),
        ({**GOOD, "up": [0, 0, 0]}, "/cameras/0/up"),
        ({**GOOD, "up": [0, 0, 7]}, "/cameras/0/up"),
        ({**GOOD, "yfov": 4}, "/cameras/0/yfov"),
        ({**GOOD, "yfov": 0}, "/cameras/0/yfov"),
        ([1], "/cameras/0"),
    ],
)
def test_errors_name_file_and_place(tmp_path, camera, pointer):
    path = write(tmp_path, camera)
    with pytest.raises(SceneError, match="expected") as error:
        read_camera_path(path, 10.0)
    assert f"{path}: {pointer}: " in str(error.value)


def test_an_empty_path_and_a_missing_file_are_refused(tmp_path):
    with pytest.raises(SceneError, match="at least one camera"):
        read_camera_path(write(tmp_path), 10.0)
    with pytest.raises(FileError):
        read_camera_path(str(tmp_path / "none.json"), 10.0)
