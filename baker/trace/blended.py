"""Path-traced frames with partly transparent surfaces, blended as the renderer blends them."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.constants import ALPHA_MIN, DECAL_DEPTH
from gsgi.runtime.scene import BLENDED_MOST, Material, Scene

from . import reference
from .mitsuba_scene import load_mitsuba, on_device
from .rays import SKIP, closest_front, side
from .tracer import Tracer
from .visible import Surface, pixel_rays

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)


class BlendedView:
    """What a camera sees of a scene in an image of width x height (px), whose light the `tracer` of that scene traces.

    Rays of light meet the stand-ins of `blended` surfaces, and those of the camera meet the blended surfaces. `solid`
    is the Surface behind them.
    """

    def __init__(self, tracer: Tracer, scene: Scene, camera: Camera, width: int, height: int):
        self._tracer, self._camera, self._size = tracer, camera, (width, height)
        shown = tuple(map(_shown, scene.materials))
        seen = tracer if shown == scene.materials else Tracer(replace(scene, materials=shown, blended=()))
        self.solid, self._films = seen.surface(camera, width, height), None
        if not scene.blended:
            return
        dark = replace(scene, meshes=scene.blended, blended=(), lights=(), environment=None)
        self._films = Tracer(replace(dark, materials=tuple(map(_cut, scene.materials))))
        self._tint = on_device(mi.Float, np.array([material.tint for material in scene.materials], np.float32))

    def final(self, samples: int, seed: int, denoised: bool, advance=None) -> np.ndarray:
        """The full light (H, W, 3) float32 by `samples` paths per pixel and surface, with B `denoised` or as traced.

        `advance(points)` is called with a total of `2 * (1 + BLENDED_MOST) * width * height`.
        """

        def light(surface: Surface) -> np.ndarray:
            truth = reference.on_surface(self._tracer, surface, samples, seed, advance)
            return truth.lit(truth.clean if denoised else truth.indirect)

        result, passes, count = np.zeros_like(self.solid.albedo), np.float32(1), 0
        for surface, opacity, through in self._layers():
            result += passes * opacity * light(surface)
            passes, count = passes * through, count + 1
        if advance:
            advance(2.0 * (BLENDED_MOST - count) * self.solid.depth.size)
        return result + passes * light(self.solid)

    def _layers(self) -> Iterator[tuple[Surface, np.ndarray, np.ndarray]]:
        """The nearest blended surfaces of each pixel, then the next, and so on, up to BLENDED_MOST: as the renderer's
        depth peeling finds them.

        With each come its opacity (H, W, 1) and the factor (H, W, 3) on the light from behind.
        """
        if self._films is None:
            return
        width, height = self._size
        y, x = (np.mgrid[0:height, 0:width] + 0.5).reshape(2, -1)
        origin, direction = pixel_rays(self._camera, width, height, x, y)
        for _ in range(BLENDED_MOST):
            surface = self._films.surface_along(self._camera, origin, direction, width, height)
            before = surface.valid & (~self.solid.valid | (surface.depth <= self.solid.depth * (1 + DECAL_DEPTH)))
            if not before.any():
                return
            cover = self._films.launched(partial(_cover, tints=self._tint), origin, direction)
            reach = cover["distance"] + SKIP * (cover["distance"] + np.abs(origin).max(axis=1))
            direction = direction * before.reshape(-1, 1)  # what sees nothing here sees nothing beyond
            origin = origin + reach[:, None].astype(np.float64) * direction
            opacity, tint = (cover[name].reshape(height, width, 1) * before[..., None] for name in ("opacity", "tint"))
            yield _masked(surface, before), opacity, (1 - opacity) * (1 + tint * (surface.albedo - 1))


def _shown(material: Material) -> Material:
    """The material, all of it a hole if it is that of a stand-in."""
    return replace(material, filter=None, alpha_cutoff=np.inf) if material.stand_in else material


def _cut(material: Material) -> Material:
    """The material with holes where a frame blends nothing."""
    if material.tint:
        return material
    return replace(material, alpha_cutoff=max(material.alpha_cutoff or 0.0, ALPHA_MIN))


def _masked(surface: Surface, where: np.ndarray) -> Surface:
    """The surface in the pixels (H, W) bool `where`, and none in others."""
    deep = where[..., None]
    return Surface(**{name: array * (deep if array.ndim == 3 else where) for name, array in vars(surface).items()})


def _cover(tracer: Tracer, origin: np.ndarray, direction: np.ndarray, tints) -> dict[str, np.ndarray]:
    """The opacity, the `tints` of its material, and the distance, m, of what rays see, each (N,), 0 if it is nothing.

    The arguments are those of `paths.first_hits`.
    """
    o, d = mi.Point3f(origin.T), mi.Vector3f(direction.T)
    hit = closest_front(tracer, o, d, dr.squared_norm(d) > 0)
    found = dr.isfinite(hit.t)
    _, material, _ = side(tracer, hit, d, found)
    columns = {
        "opacity": dr.clip(tracer.shading.opacity(material, hit.prim, hit.b, found), 0, 1),
        "tint": dr.gather(mi.Float, tints, material, found),
        "distance": hit.t,
    }
    columns = {name: dr.select(found, column, 0) for name, column in columns.items()}
    dr.eval(columns)
    return {name: np.array(column) for name, column in columns.items()}
