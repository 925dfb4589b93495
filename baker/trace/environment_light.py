"""The environment as a light of the path tracer: its radiance, and directions sampled in proportion to it."""

import numpy as np

from gsgi.runtime.scene import Environment

from .mitsuba_scene import load_mitsuba, on_device

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)


class EnvironmentLight:
    """The environment on the device. `samples_light`: whether to sample it; if uniform, cosine sampling suffices."""

    def __init__(self, environment: Environment):
        self.height, self.width = environment.radiance.shape[:2]
        self.samples_light = not environment.even
        self.radiance = on_device(mi.Float, environment.radiance)
        self.cos, self.sin = float(np.cos(environment.rotation)), float(np.sin(environment.rotation))
        if self.samples_light:
            edges = np.cos(np.linspace(0, np.pi, self.height + 1))
            solid_angle = (edges[:-1] - edges[1:]) * 2 * np.pi / self.width
            weight = environment.radiance.mean(axis=2, dtype=np.float64) * solid_angle[:, None]
            weight /= weight.sum()
            self.distribution = mi.DiscreteDistribution2D(weight.astype(np.float32))
            self.density = on_device(mi.Float, weight / solid_angle[:, None])
            self.edges = on_device(mi.Float, edges)

    def eval(self, direction, active):
        """Radiance (Color3f) from unit `direction`, and the density (1/sr) of `sample` there, 0 if it is not used."""
        index = self._texel(direction)
        radiance = dr.gather(mi.Color3f, self.radiance, index, active)
        density = dr.gather(mi.Float, self.density, index, active) if self.samples_light else mi.Float(0)
        return radiance, density

    def sample(self, u):
        """A direction from `u` Point2f in [0, 1)^2: (Vector3f, radiance, density in 1/sr)."""
        texel, _, u = self.distribution.sample(u)
        # Uniform in solid angle within the texel: in azimuth and in the cosine of the polar angle.
        phi = (mi.Float(texel.x) + u.x - 0.5 * self.width) * (2 * np.pi / self.width)
        top, bottom = dr.gather(mi.Float, self.edges, texel.y), dr.gather(mi.Float, self.edges, texel.y + 1)
        y = top + (bottom - top) * u.y
        horizontal = dr.safe_sqrt(1 - y * y)
        x, z = dr.sin(phi) * horizontal, -dr.cos(phi) * horizontal
        index = texel.y * self.width + texel.x
        radiance, density = dr.gather(mi.Color3f, self.radiance, index), dr.gather(mi.Float, self.density, index)
        return mi.Vector3f(self.cos * x + self.sin * z, y, self.cos * z - self.sin * x), radiance, density

    def _texel(self, direction):
        """Index of the texel in `direction`, the inverse of the mapping in `sample`."""
        x = self.cos * direction.x - self.sin * direction.z
        z = self.cos * direction.z + self.sin * direction.x
        u = dr.atan2(x, -z) * dr.inv_two_pi + 0.5
        v = dr.safe_acos(direction.y) * dr.inv_pi
        column = dr.minimum(mi.UInt32(dr.maximum(u, 0) * self.width), self.width - 1)
        row = dr.minimum(mi.UInt32(dr.maximum(v, 0) * self.height), self.height - 1)
        return row * self.width + column
