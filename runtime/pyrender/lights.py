"""Lights of a pyrender scene as uniforms of glsl/pyrender/forward.frag."""

from typing import NamedTuple

import numpy as np

from .dimming import Dimming
from .flags import RenderFlags

MOST = 4  # lights of each kind per mesh
_EDGE_MIN = 0.001  # difference of cosines; least width of a spot's edge


class PlacedLight(NamedTuple):
    """A pyrender Light at its node's `pose` (4, 4). `kind` is "point", "spot" or "directional"."""

    kind: str
    light: object
    pose: np.ndarray
    names: tuple[str, ...]  # of the node and of the light, where they have some

    @property
    def direction(self) -> np.ndarray:
        """(3,) direction in which the light travels."""
        return -self.pose[:3, 2]


def lights(scene) -> list[PlacedLight]:
    """All lights of a scene."""
    kinds = {
        "point": scene.point_light_nodes,
        "spot": scene.spot_light_nodes,
        "directional": scene.directional_light_nodes,
    }
    return [
        PlacedLight(kind, node.light, scene.get_pose(node), tuple(n for n in (node.name, node.light.name) if n))
        for kind, nodes in kinds.items()
        for node in nodes
    ]


def casts_shadows(light: PlacedLight, flags: int) -> bool:
    """Whether `flags` ask for shadows of the light. Raises NotImplementedError for a point light, as pyrender does."""
    flag = {
        "point": RenderFlags.SHADOWS_POINT,
        "spot": RenderFlags.SHADOWS_SPOT,
        "directional": RenderFlags.SHADOWS_DIRECTIONAL,
    }[light.kind]
    if flags & flag and light.kind == "point":
        raise NotImplementedError("Shadows not implemented for point lights")
    return bool(flags & flag)


def nearest(placed: list[PlacedLight], position: np.ndarray) -> list[int]:
    """Indices of the lights nearest to `position` (3,), at most `MOST` of each kind."""
    order = sorted(range(len(placed)), key=lambda i: np.linalg.norm(placed[i].pose[:3, 3] - position))
    chosen = []
    for kind in ("point", "spot", "directional"):
        chosen += [i for i in order if placed[i].kind == kind][:MOST]
    return chosen


def uniforms(placed: list[PlacedLight], dimming: Dimming) -> dict:
    """Uniforms `light_*` of one or more lights under the weights of their groups."""
    return {
        "light_place": [light.pose[:3, 3] if light.kind != "directional" else -light.direction for light in placed],
        "light_near": [light.kind != "directional" for light in placed],
        "light_color": [
            np.multiply(light.light.color, light.light.intensity) * dimming.factor(light.names) for light in placed
        ],
        "light_direction": [light.direction for light in placed],
        "light_cone": [_cone(light) for light in placed],
    }


def _cone(light: PlacedLight) -> tuple[float, float]:
    if light.kind != "spot":
        return 0.0, 1.0
    inner, outer = np.cos(light.light.innerConeAngle), np.cos(light.light.outerConeAngle)
    factor = 1 / max(_EDGE_MIN, inner - outer)
    return factor, -outer * factor
