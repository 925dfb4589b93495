"""Punctual lights in the path tracer: the same formula as glsl/frame/light.glsl."""

from collections.abc import Sequence

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.scene import Light

from .mitsuba_scene import load_mitsuba, on_device

_KINDS = {"point": 0, "spot": 1, "directional": 2}


class PunctualLights:
    """The lights of a scene whose bounding box has the corners `low` and `high` (3,), m, as tables for kernels.

    Only the kinds of light that occur are compiled into the kernel.
    """

    def __init__(self, lights: Sequence[Light], low: np.ndarray, high: np.ndarray):
        mi = load_mitsuba()
        from .light_choice import LightChoice

        self.count = len(lights)
        self.kinds = {light.kind for light in lights}
        if not lights:
            return

        def columns(name: str) -> np.ndarray:
            return np.array([getattr(light, name) for light in lights], np.float32).T

        def vectors(kind: type, name: str):
            return kind(*(on_device(mi.Float, column) for column in columns(name)))

        self.kind = on_device(mi.UInt32, [_KINDS[light.kind] for light in lights])
        self.position, self.direction = vectors(mi.Point3f, "position"), vectors(mi.Vector3f, "direction")
        self.color = vectors(mi.Color3f, "color")
        self.range, self.cos_inner, self.cos_outer = (
            on_device(mi.Float, columns(name)) for name in ("range", "cos_inner", "cos_outer")
        )
        diagonal = float(np.linalg.norm(high - low))
        self._middle, self._radius = mi.Point3f((low + high).astype(np.float64) / 2), diagonal / 2
        somewhere = np.array([light.kind != "directional" for light in lights])
        place = np.where(somewhere[:, None], columns("position").T, np.inf)
        self.choice = LightChoice(_probabilities(lights, diagonal), place, np.zeros(len(lights)))

    def leave(self, index, at):
        """A ray (Point3f, Vector3f unit) of light `index` in the direction `at`, Point2f in [0, 1)^2.

        Directions are even over what a local light sees, and over the scene's width as a directional light sees it.
        """
        import drjit as dr

        mi = load_mitsuba()
        axis = dr.gather(mi.Vector3f, self.direction, index)
        frame, narrowest = mi.Frame3f(axis), self._narrowest(index)
        z = narrowest + (1 - narrowest) * at.x
        sin, cos = dr.sincos(dr.two_pi * at.y)
        around = dr.safe_sqrt(1 - z * z)
        d = frame.to_world(mi.Vector3f(around * cos, around * sin, z))
        across = (2 * at - 1) * self._radius
        far = self._middle + frame.to_world(mi.Vector3f(across.x, across.y, -self._radius))
        directional = dr.gather(mi.UInt32, self.kind, index) == _KINDS["directional"]
        return dr.select(directional, far, dr.gather(mi.Point3f, self.position, index)), dr.select(directional, axis, d)

    def left(self, index, point):
        """The inverse of `leave`: in which direction `at` light leaves to come to a point (Point3f, m).

        Returns `at`; how much of the square of directions there is per m^2 that faces the light; and the unit
        direction in which it travels.
        """
        import drjit as dr

        mi = load_mitsuba()
        axis = dr.gather(mi.Vector3f, self.direction, index)
        frame, narrowest = mi.Frame3f(axis), self._narrowest(index)
        across = frame.to_local(point - self._middle) / (2 * self._radius) + 0.5
        at, per_area, towards = mi.Point2f(across.x, across.y), mi.Float(1 / (4 * self._radius**2)), axis
        if self.kinds & {"point", "spot"}:
            local = dr.gather(mi.UInt32, self.kind, index) != _KINDS["directional"]
            offset = point - dr.gather(mi.Point3f, self.position, index)
            squared = dr.squared_norm(offset)
            direction = offset * dr.rsqrt(squared)
            seen = frame.to_local(direction)
            turn = dr.atan2(seen.y, seen.x) * (0.5 * dr.inv_pi)
            of_local = mi.Point2f((seen.z - narrowest) / (1 - narrowest), dr.select(turn < 0, turn + 1, turn))
            at = dr.select(local, of_local, at)
            per_area = dr.select(local, dr.rcp(dr.two_pi * (1 - narrowest) * squared), per_area)
            towards = dr.select(local, direction, axis)
        return at, per_area, towards

    def _narrowest(self, index):
        """The cosine of the angle from its axis beyond which a light sends none."""
        import drjit as dr

        mi = load_mitsuba()
        spot = dr.gather(mi.UInt32, self.kind, index) == _KINDS["spot"]
        return dr.select(spot, dr.gather(mi.Float, self.cos_outer, index), -1)

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
