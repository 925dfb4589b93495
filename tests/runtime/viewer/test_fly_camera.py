"""The viewer's camera."""

import numpy as np
import pytest

from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.viewer.fly_camera import CROSSING, FASTER, STEEPEST, TURN, FlyCamera

UP = np.array([0.0, 1.0, 0.0])
DIAGONAL = 4.0


def flying(target=(0.0, 0.0, -1.0), up=UP) -> FlyCamera:
    return FlyCamera(look_at(np.zeros(3), np.array(target), np.asarray(up), 0.8, 0.01, 50.0), DIAGONAL)


def forward(fly: FlyCamera) -> np.ndarray:
    return -fly.camera.world_from_view[:3, 2]


def assert_rigid(camera: Camera) -> None:
    rotation = camera.world_from_view[:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_it_starts_as_the_camera_that_it_is_given():
    camera = look_at(np.array([1.0, 2, 3]), np.zeros(3), np.array([0.3, 1.0, 0.1]), 0.7, 0.02, 30.0)
    fly = FlyCamera(camera, DIAGONAL)
    assert fly.camera is camera
    fly.move((0, 0, 0), 1.0)
    assert fly.camera is camera


@pytest.mark.parametrize(
    ("direction", "way"),
    [((1, 0, 0), (1, 0, 0)), ((0, 1, 0), (0, 1, 0)), ((0, 0, 1), (0, 0, 1)), ((0, 0, -1), (0, 0, -1))],
)
def test_keys_lead_along_the_axes(direction, way):
    fly = flying()
    fly.move(direction, 2.0)
    assert fly.camera.position == pytest.approx(2 * DIAGONAL / CROSSING * np.array(way))
    assert (fly.camera.yfov, fly.camera.znear, fly.camera.zfar) == (0.8, 0.01, 50.0)


def test_forward_is_where_it_looks_and_up_is_the_worlds():
    fly = flying(target=(3.0, -4.0, 0.0))
    fly.move((0, 0, -1), 1.0)
    assert fly.camera.position / np.linalg.norm(fly.camera.position) == pytest.approx([0.6, -0.8, 0])
    before = fly.camera.position
    fly.move((0, -1, 0), 1.0)
    assert fly.camera.position - before == pytest.approx([0, -DIAGONAL / CROSSING, 0])


def test_two_keys_are_no_faster_than_one_and_shift_is():
    slow, fast = flying(), flying()
    slow.move((1, 0, -1), 1.0)
    fast.move((1, 0, -1), 1.0, fast=True)
    assert np.linalg.norm(slow.camera.position) == pytest.approx(DIAGONAL / CROSSING)
    assert fast.camera.position == pytest.approx(FASTER * slow.camera.position)


def test_the_mouse_turns_where_it_goes():
    fly = flying()
    fly.turn(100, 0)
    assert forward(fly) == pytest.approx([np.sin(100 * TURN), 0, -np.cos(100 * TURN)])
    fly = flying()
    fly.turn(0, 100)
    assert forward(fly) == pytest.approx([0, -np.sin(100 * TURN), -np.cos(100 * TURN)])
    assert_rigid(fly.camera)


def test_it_neither_tips_over_nor_rolls():
    fly = flying()
    for _ in range(500):
        fly.turn(7, -40)
    assert np.arcsin(forward(fly)[1]) == pytest.approx(STEEPEST)
    assert fly.camera.world_from_view[1, 0] == pytest.approx(0, abs=1e-9)  # the horizon is level
    assert_rigid(fly.camera)
    fly.turn(0, 100)
    assert np.arcsin(forward(fly)[1]) == pytest.approx(STEEPEST - 100 * TURN)


def test_a_camera_that_looks_straight_down_can_look_up():
    fly = flying(target=(0.0, -1.0, 0.0), up=(0.0, 0.0, -1.0))
    fly.turn(0, -100)
    assert np.arcsin(forward(fly)[1]) == pytest.approx(-np.pi / 2 + 100 * TURN)
    assert forward(fly)[2] < 0
    assert_rigid(fly.camera)


def test_a_roll_stays():
    fly = flying(up=(1.0, 1.0, 0.0))
    fly.turn(50, 0)
    assert fly.camera.world_from_view[1, 0] == pytest.approx(-(0.5**0.5))
