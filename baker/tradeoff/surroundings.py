"""The environment as light from many directions, for what stores it by direction."""

import numpy as np

from gsgi.runtime.scene import Environment

ROWS = 64  # at least, so that an even environment has directions too


def texels(environment: Environment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit directions (T, 3) of an environment's texels, in world space, radiance (T, 3), solid angle (T,), sr."""
    finer = -(-ROWS // environment.radiance.shape[0]), -(-2 * ROWS // environment.radiance.shape[1])
    radiance = environment.radiance.repeat(finer[0], axis=0).repeat(finer[1], axis=1)
    height, width = radiance.shape[:2]
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    y = np.repeat((edges[:-1] + edges[1:]) / 2, width)
    phi = np.tile((np.arange(width) + 0.5 - width / 2) * (2 * np.pi / width), height) - environment.rotation
    level = np.sqrt(1 - y * y)
    direction = np.stack([np.sin(phi) * level, y, -np.cos(phi) * level], axis=1)
    solid_angle = np.repeat((edges[:-1] - edges[1:]) * 2 * np.pi / width, width)
    return direction, radiance.reshape(-1, 3).astype(np.float64), solid_angle
