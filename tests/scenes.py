"""Tiny scenes with known answers, built as records."""

import numpy as np

from gsgi.runtime.camera import Camera, look_at
from gsgi.runtime.scene import Light, Material, Mesh, Scene

WHITE = Material(name="white", base_color=(0.5, 0.5, 0.5, 1.0))


def quad(corners, material: int = 0) -> Mesh:
    """A rectangle from four corners (4, 3), counter-clockwise seen from the front."""
    position = np.asarray(corners, np.float32)
    normal = np.cross(position[1] - position[0], position[3] - position[0])
    normal = np.tile(normal / np.linalg.norm(normal), (4, 1)).astype(np.float32)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)[:, None]
    return Mesh(position, normal, uv, np.array([[0, 1, 2], [0, 2, 3]], np.uint32), material)


def floor(half: float = 1.0, height: float = 0.0, material: int = 0) -> Mesh:
    """A square of edge 2 * `half` in the plane y = `height`, facing +Y."""
    corners = [(-half, height, half), (half, height, half), (half, height, -half), (-half, height, -half)]
    return quad(corners, material)


def thin_wall() -> list[Mesh]:
    """Both faces of a wall of 1 mm across the floor, from side to side, in the plane x = 0."""
    faces = (-0.0005, -1.0), (0.0005, 1.0)
    return [quad([(x, -0.1, z), (x, -0.1, -z), (x, 1, -z), (x, 1, z)]) for x, z in faces]


def box(half: float = 1.0, material: int = 0, inward: bool = True) -> list[Mesh]:
    """The six walls of a cube of edge 2 * `half` around the origin."""
    walls = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = np.roll(np.eye(3), axis, axis=1)[1:]
            centre = sign * np.roll(np.eye(3), axis, axis=1)[0]
            corners = half * np.array([centre - u - v, centre + u - v, centre + u + v, centre - u + v])
            facing_out = np.dot(np.cross(corners[1] - corners[0], corners[3] - corners[0]), centre) > 0
            walls.append(quad(corners[::-1] if facing_out == inward else corners, material))
    return walls


def furnace(albedo: float = 0.5, emission: float = 1.0) -> Scene:
    """A closed cube whose walls all emit `emission`, so that B = emission / (1 - albedo) everywhere."""
    wall = Material("wall", (albedo, albedo, albedo, 1.0), emission=(emission,) * 3)
    return Scene(tuple(box()), (wall,), cameras={"inside": inside_camera()})


def spot_room() -> Scene:
    """A closed grey cube with a narrow spot in its middle, which lights a small patch of the floor."""
    spot = Light("spot", np.full(3, 9.0), np.zeros(3), np.array([0.0, -1.0, 0.0]), cos_inner=0.99, cos_outer=0.97)
    return Scene(tuple(box()), (WHITE,), lights=(spot,))


def inside_camera() -> Camera:
    """A camera near the middle of `box()`, looking down -Z and a little to the side."""
    return look_at(np.array([0.2, 0.1, 0.7]), np.array([0.0, -0.2, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)


def lit_floor(light: Light, half: float = 20.0) -> Scene:
    """A grey floor of albedo 0.5 under one punctual light."""
    return Scene((floor(half),), (WHITE,), lights=(light,), cameras={"above": above_camera()})


def above_camera(height: float = 3.0) -> Camera:
    """A camera at (0, height, 0) that looks straight down, with the top of the image towards -Z."""
    return look_at(np.array([0.0, height, 0.0]), np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.9, 0.01)
