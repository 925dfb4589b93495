"""Emissive triangles as lights: those that bring light are likely, and points on one are equally likely."""

import numpy as np

from gsgi.runtime.scene import Scene

from .light_choice import LightChoice
from .mitsuba_scene import load_mitsuba, on_device
from .surface_tables import Surfaces

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

PROBES = 16  # texels read to estimate the brightness of a triangle of a textured emitter


class Emitters:
    """The emissive triangles of a scene. `count` is 0 if there are none."""

    def __init__(self, scene: Scene, surfaces: Surfaces):
        material = surfaces.face[:, 3].view(np.uint32)
        has_area = surfaces.face[:, :3].any(axis=1)
        lit = np.flatnonzero(np.array([scene.emits(m) for m in scene.materials], bool)[material] & has_area)
        self.count = len(lit)
        if not self.count:
            return
        corners = surfaces.position[surfaces.triangle[lit]].astype(np.float64)
        edges = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
        brightness = _brightness(scene, surfaces, lit)
        self.choice = LightChoice(area * brightness, corners.mean(axis=1), np.ptp(corners, axis=1).max(axis=1))
        rows = np.zeros((self.count, 12), np.float32)
        rows[:, :3], rows[:, 4:7], rows[:, 8:11] = corners[:, 0], edges[:, 0], edges[:, 1]
        rows[:, 3], rows[:, 7], rows[:, 11] = lit.astype(np.uint32).view(np.float32), 1 / area, brightness
        self.corners = on_device(mi.Float, rows)
        # Index of each triangle of the scene among the emissive ones, and its probability density (1/m^2) in its own
        # cluster: 0 if it does not emit.
        number = np.zeros(len(surfaces.triangle), np.uint32)
        number[lit] = np.arange(self.count)
        within = np.zeros(len(surfaces.triangle), np.float32)
        within[lit] = self.choice.within() / area
        self._number, self._within = on_device(mi.UInt32, number), on_device(mi.Float, within)

    def sample(self, index, v):
        """A point on emissive triangle `index` from `v` Point2f in [0, 1).

        Returns Point3f, prim, b, density in 1/m^2, and about how bright the triangle is.
        """
        b = mi.warp.square_to_uniform_triangle(v)
        row = [dr.gather(mi.Vector4f, self.corners, 3 * index + k) for k in range(3)]
        at, first, second = (mi.Vector3f(r.x, r.y, r.z) for r in row)
        prim = dr.reinterpret_array(mi.UInt32, row[0].w)
        return mi.Point3f(at + first * b.x + second * b.y), prim, b, row[1].w, row[2].w

    def density(self, row, cell, active):
        """The density (1/m^2) of what `choice` and `sample` choose in `cell` on a row's triangle; 0 if it is dark."""
        within = dr.gather(mi.Float, self._within, row, active)
        emits = active & (within > 0)
        return within * self.choice.likely(dr.gather(mi.UInt32, self._number, row, emits), cell, emits)


def _brightness(scene: Scene, surfaces: Surfaces, lit: np.ndarray) -> np.ndarray:
    """Estimate (L,) of each emissive triangle's mean radiance; never 0."""
    material = surfaces.face[lit, 3].view(np.uint32)
    result = np.empty(len(lit))
    for index in np.unique(material):
        of = scene.materials[index]
        factor, at = float(np.mean(of.emission)), np.flatnonzero(material == index)
        result[at] = factor
        if of.emission_texture is not None:
            texture = scene.textures[of.emission_texture.texture].pixels
            seen = _probed(texture, surfaces.uv[lit[at], of.emission_texture.uv])
            # Half from the triangle's own texels, half from the mean, which includes texels that the probes miss.
            result[at] *= (seen + texture[..., :3].mean() / 255) / 2 + 1e-3
    return result


def _probed(pixels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Mean stored value (T,) in [0, 1] of texels spread over triangles with corners `uv` (T, 8)."""
    rng = np.random.default_rng(0)
    b = rng.dirichlet((1, 1, 1), PROBES)
    points = np.einsum("pk,tkc->tpc", b, uv[:, :6].reshape(-1, 3, 2).astype(np.float64)) % 1
    height, width = pixels.shape[:2]
    x, y = (np.minimum((points[..., i] * size).astype(int), size - 1) for i, size in enumerate((width, height)))
    return pixels[y, x, :3].mean(axis=(1, 2)) / 255
