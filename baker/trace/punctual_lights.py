"""Punctual lights in the path tracer: the same formula as glsl/frame/light.glsl."""

from collections.abc import Sequence

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.scene import Light

from .mitsuba_scene import load_mitsuba

_KINDS = {"point": 0, "spot": 1, "directional": 2}


class PunctualLights:
    """The lights of a scene with this diagonal (m), as tables that a kernel gathers from.

    Only the kinds of light that occur are compiled into the kernel.
    """

    def __init__(self, lights: Sequence[Light], diagonal: float):
        mi = load_mitsuba()
        self.count = len(lights)
        self.kinds = {light.kind for light in lights}
        if not lights:
            return
        columns = {name: np.array([getattr(light, name) for light in lights], np.float32).T for name in (
            "position", "direction", "color", "range", "cos_inner", "cos_outer")}  # fmt: skip
        self.kind = mi.UInt32([_KINDS[light.kind] for light in lights])
        self.position = mi.Point3f(columns["position"])
        self.direction = mi.Vector3f(columns["direction"])
        self.color = mi.Color3f(columns["color"])
        self.range = mi.Float(columns["range"])
        self.cos_inner = mi.Float(columns["cos_inner"])
        self.cos_outer = mi.Float(columns["cos_outer"])
        self.distribution = mi.DiscreteDistribution(mi.Float(_probabilities(lights, diagonal).astype(np.float32)))

    def sample(self, u):
        """Sample a light; bright ones are likelier. `u` Float in [0, 1) -> (index UInt32, 1 / probability Float)."""
        import drjit as dr

        index, pdf = self.distribution.sample_pmf(u)
        return index, dr.rcp(pdf)

    def arriving(self, index, point):
        """Unshadowed light of light `index` at `point` (Point3f, m).

        Returns the unit direction towards the light, the distance to it (m, infinite for directional) and the light
        that falls on a surface facing it (Color3f, W/m^2-like). After KHR_lights_punctual (Khronos 2018): the inverse
        square times a window that ends at the range, and a squared saturate for the spot's cone.
        """
        import drjit as dr

        mi = load_mitsuba()
        kind = dr.gather(mi.UInt32, self.kind, index)
        color = dr.gather(mi.Color3f, self.color, index)
        axis = dr.gather(mi.Vector3f, self.direction, index)
        wi, distance, attenuation = -axis, mi.Float(dr.inf), mi.Float(1.0)
        if self.kinds & {"point", "spot"}:
            local = kind != _KINDS["directional"]
            offset = dr.gather(mi.Point3f, self.position, index) - point
            distance = dr.select(local, dr.norm(offset), dr.inf)
            wi = dr.select(local, offset / distance, -axis)
            reach = dr.gather(mi.Float, self.range, index)
            window = dr.clip(1 - dr.square(dr.square(distance / reach)), 0, 1)
            attenuation = dr.select(local, window / dr.square(distance), 1.0)
        if "spot" in self.kinds:
            inner, outer = (dr.gather(mi.Float, c, index) for c in (self.cos_inner, self.cos_outer))
            width = dr.maximum(constants.SPOT_ANGLE_MIN, inner - outer)
            cone = dr.square(dr.clip((dr.dot(-wi, axis) - outer) / width, 0, 1))
            attenuation *= dr.select(kind == _KINDS["spot"], cone, 1.0)
        return wi, distance, color * attenuation


def _probabilities(lights: Sequence[Light], diagonal: float) -> np.ndarray:
    """Probability (N,) of each light: half by power, half uniform, because a weak light is bright at close range."""
    power = np.array([light.color.mean() * _extent(light, diagonal) for light in lights], np.float64)
    total = power.sum()
    return (power / total + 1 / len(lights)) / 2 if total > 0 else np.full(len(lights), 1 / len(lights))


def _extent(light: Light, diagonal: float) -> float:
    """Factor from a light's colour to its power: solid angle (sr), or the area of the scene's bounds (m^2)."""
    match light.kind:
        case "point":
            return 4 * np.pi
        case "spot":
            return 2 * np.pi * (1 - light.cos_outer)
        case "directional":
            return np.pi * (diagonal / 2) ** 2
    raise AssertionError(light.kind)
