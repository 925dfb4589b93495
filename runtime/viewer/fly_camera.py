"""A camera that flies: keys move it and the mouse turns it."""

from dataclasses import replace

import numpy as np

from gsgi.runtime.camera import Camera

TURN = 0.003  # rad per px that the mouse moves
STEEPEST = np.radians(89)  # above and below the horizon; past the vertical, left and right would swap
CROSSING = 8.0  # s to fly along the scene's diagonal
FASTER = 5.0


class FlyCamera:
    """Starts exactly as `camera` and keeps its roll. The speed depends on the scene's `diagonal`, m."""

    def __init__(self, camera: Camera, diagonal: float):
        self.camera = camera
        self._diagonal, self._speed = diagonal, diagonal / CROSSING

    def flags(self) -> str:
        """The options of `gsgi render` for this camera, without its roll, to a hundred-thousandth of the diagonal."""
        return self.camera.flags(self._diagonal)

    def turn(self, dx: float, dy: float) -> None:
        """Look around by a mouse movement to the right (`dx`) and down (`dy`), px."""
        rotation = self.camera.world_from_view[:3, :3]
        elevation = np.arcsin(np.clip(-rotation[1, 2], -1, 1))
        steepest = max(STEEPEST, abs(elevation))
        pitch = np.clip(elevation - TURN * dy, -steepest, steepest) - elevation
        self._pose(_about(1, -TURN * dx) @ rotation @ _about(0, pitch), self.camera.position)

    def move(self, direction: tuple[float, float, float], seconds: float, fast: bool = False) -> None:
        """Fly along `direction` (right, up, back): right and back are the camera's axes, up is the world's."""
        right, up, back = direction
        rotation = self.camera.world_from_view[:3, :3]
        way = right * rotation[:, 0] + np.array([0.0, up, 0.0]) + back * rotation[:, 2]
        length = np.linalg.norm(way)
        if length > 0:
            step = self._speed * seconds * (FASTER if fast else 1.0)
            self._pose(rotation, self.camera.position + step / length * way)

    def _pose(self, rotation: np.ndarray, position: np.ndarray) -> None:
        x, y = rotation[:, 0] / np.linalg.norm(rotation[:, 0]), rotation[:, 1]
        y = y - (y @ x) * x
        y /= np.linalg.norm(y)
        world_from_view = np.eye(4)
        world_from_view[:3] = np.stack([x, y, np.cross(x, y), position], axis=1)
        self.camera = replace(self.camera, world_from_view=world_from_view)


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation (3, 3) about a coordinate axis by `angle` (rad), counter-clockwise."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[u, u, v, v], [u, v, u, v]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return rotation
