"""The light that points receive from triangles which shine: the last step of radiosity."""

import numpy as np

from .patched_surface import PatchedSurface

RAYS = 256  # from each point, and as many again to where the light is
SHORT = 0.999  # of the way to a place that is seen no surface is met


class Gather:
    """Gathers the radiance (F, 3) of the triangles of `surface`.

    Half of the rays have the density of the cosine, and half end at points chosen by their light, which finds what is
    small and bright; both are weighed by the balance heuristic (Veach 1995).
    """

    def __init__(self, surface: PatchedSurface, radiance: np.ndarray):
        self._surface, self._radiance = surface, radiance
        brightness = radiance.mean(axis=1)
        self._below = np.cumsum(brightness * surface.area)
        self._density = brightness / max(self._below[-1], 1e-30)  # of chosen points, per m^2

    def at(self, position: np.ndarray, normal: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """B (N, 3) at points (N, 3) with unit normals (N, 3), and the share (N,) of rays that meet backs."""
        shape = len(position), RAYS
        seen, place = self._surface.seen(position, normal, RAYS, rng)
        light = self._weighed(position, normal, seen, place)
        u = (np.arange(RAYS) + rng.random(shape)) / RAYS * self._below[-1]
        chosen = np.minimum(np.searchsorted(self._below, u.reshape(-1), side="right"), len(self._below) - 1)
        place = self._surface.inside(chosen, rng).reshape(*shape, 3)
        lit = np.where(self._visible(position, normal, place), chosen.reshape(shape), -1)
        return light + self._weighed(position, normal, lit, place), (seen == -2).mean(axis=1)

    def _visible(self, position: np.ndarray, normal: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Which places (N, R, 3) points (N, 3) see."""
        origin = (position + self._surface.lift * normal)[:, None]
        way = (place - origin).reshape(-1, 3)
        blocked = self._surface.hits.first(np.broadcast_to(origin, place.shape).reshape(-1, 3), way, SHORT)[0]
        return ~blocked.reshape(place.shape[:2])

    def _weighed(self, position: np.ndarray, normal: np.ndarray, seen: np.ndarray, place: np.ndarray) -> np.ndarray:
        """What rays (N, R) that end at `place` (N, R, 3) on triangles `seen`, none where negative, give to B (N, 3)."""
        surface, way = self._surface, place - position[:, None]
        squared = np.maximum((way * way).sum(axis=2), 1e-30)
        cosine = (way * normal[:, None]).sum(axis=2) / np.sqrt(squared)
        there = -(way * surface.face[seen]).sum(axis=2) / np.sqrt(squared)
        there = np.where(surface.double_sided[seen], np.abs(there), there)
        told = (seen >= 0) & (cosine > 0) & (there > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_light = np.pi * self._density[seen] * squared / (cosine * there)  # relative to the cosine's density
            weight = np.where(told, 1 / (1 + by_light), 0)
        return (weight[..., None] * self._radiance[seen]).sum(axis=1) / RAYS
