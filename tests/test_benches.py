"""What the benchmarks of motion and of flights compute, apart from the bakes that they measure."""

import numpy as np
import pytest
from benches import motion
from benches.drawn_frames import Frame
from benches.flight import step_of

from gsgi.runtime.camera import look_at


def wall(camera, light) -> Frame:
    """A wall in the plane z = 0 that shows light(position) of its points."""
    depth = np.zeros((48, 64), np.float32)
    frame = Frame(camera, np.zeros((48, 64, 3), np.float32), np.zeros((48, 64, 3), np.float32), depth + 1)
    ray = motion.positions(frame) - camera.position
    depth = (-camera.position[2] / ray[..., 2]).astype(np.float32)
    normal = np.broadcast_to(np.float32([0, 0, 1]), (48, 64, 3))
    frame = Frame(camera, frame.indirect, normal, depth)
    return Frame(camera, light(motion.positions(frame)), normal, depth)


def test_light_that_stays_on_a_wall_does_not_change_and_light_that_moves_along_does():
    start = look_at(np.array([0.3, 0.2, 2.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    before, after, *_ = motion.slow_path(start, np.array([1.0, 0, 0]), 0.01)

    def still(position):
        return position @ np.diag([0.1, 0.2, 0.3])

    found = motion.changes(wall(before, still), wall(after, still))
    assert len(found) > 50
    assert np.abs(found).max() < 1e-5  # linear: interpolation is exact, up to float32 depths
    moved = motion.changes(wall(before, still), wall(after, lambda p: still(p) + 0.01))
    assert moved == pytest.approx(0.01, abs=1e-5)


def test_slow_cameras_move_and_turn_evenly():
    start = look_at(np.array([0.0, 1.0, 2.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    cameras = motion.slow_path(start, np.array([0, 0, 1.0]), 0.02)
    assert len(cameras) == motion.STEPS + 1
    moved = cameras[-1].position - start.position
    assert moved == pytest.approx([0, 0, 0.02 * motion.STEPS])
    ahead = [camera.world_from_view[:3, 2] for camera in cameras]
    angle = np.arccos(ahead[0] @ ahead[-1])
    assert angle == pytest.approx(motion.TURN * motion.STEPS)
    assert cameras[-1].world_from_view[:3, 0] @ ahead[0] < 0  # to the left


def test_edges_and_creases_are_not_smooth():
    camera = look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    depth, normal = np.ones((8, 20), np.float32), np.zeros((8, 20, 3), np.float32)
    depth[:, 5:] = 1.1  # an edge between columns 4 and 5
    depth[:, 15:] = 0  # nothing
    normal[:, :10] = 0, 0, 1  # a crease between columns 9 and 10
    normal[:, 10:] = 0, 1, 0
    smooth = Frame(camera, np.zeros_like(normal), normal, depth).smooth
    assert not smooth[[0, -1]].any()
    assert np.flatnonzero(smooth[3]).tolist() == [1, 2, 3, 6, 7, 8, 11, 12, 13]


def test_steps_of_light_are_relative_to_the_brightest_frame_of_each_point():
    light = np.array([[0.0, 5.0, 2.0, 0.0], [0.0, 5.0, 2.0, 0.0], [0.0, 5.0, 0.5, 0.0]])
    assert step_of(light[:2]) == 0
    assert step_of(light) == pytest.approx(255 * (1 - 0.537), abs=0.1)  # a quarter of the light, encoded
