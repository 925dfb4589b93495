"""Path-traced frames with partly transparent surfaces, blended as the renderer blends them."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.constants import ALPHA_MIN, DECAL_DEPTH
from gsgi.runtime.scene import BLENDED_MOST, Material, Scene

from . import reference
from .mitsuba_scene import load_mitsuba
from .rays import beyond, closest_front, side
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
        self._tracer, self._scene, self._camera, self._size = tracer, scene, camera, (width, height)
        behind = _behind(scene)
        self.solid = (tracer if behind is scene else Tracer(behind)).surface(camera, width, height)

    def final(
        self, samples: int, seed: int, indirect: Callable[[reference.Reference], np.ndarray], advance=None
    ) -> np.ndarray:
        """The full light (H, W, 3) float32 by `samples` paths per pixel and surface.

        Of each surface's reference, it takes the `indirect` light B (H, W, 3), denoised or not. `advance(points)` is
        called with a total of `2 * width * height` for each surface that a pixel may show, which are 1 + BLENDED_MOST
        if the scene has blended ones.
        """

        def light(surface: Surface, seed) -> np.ndarray:
            truth = reference.on_surface(self._tracer, surface, samples, seed, advance)
            return truth.lit(indirect(truth))

        result, passes, count = np.zeros_like(self.solid.albedo), np.float32(1), 0
        for surface, opacity, through in self._layers():
            count += 1
            result += passes * opacity * light(surface, (seed, count))  # each by its own noise, which does not add up
            passes = passes * through
        if advance and self._scene.blended:
            advance(2.0 * (BLENDED_MOST - count) * self.solid.depth.size)
        return result + passes * light(self.solid, seed)

    @cached_property
    def _films(self) -> Tracer:
        """Traces rays to the blended surfaces, which only the final light needs."""
        scene = self._scene
        dark = replace(scene, meshes=scene.blended, blended=(), lights=(), environment=None)
        return Tracer(replace(dark, materials=tuple(map(_cut, scene.materials))))

    def _layers(self) -> Iterator[tuple[Surface, np.ndarray, np.ndarray]]:
        """The nearest blended surfaces of each pixel, then the next, and so on, up to BLENDED_MOST: as the renderer's
        depth peeling finds them.

        With each come its opacity (H, W, 1) and the factor (H, W, 3) on the light from behind.
        """
        if not self._scene.blended:
            return
        tints = np.array([material.tint for material in self._scene.materials], np.float32)
        width, height = self._size
        y, x = (np.mgrid[0:height, 0:width] + 0.5).reshape(2, -1)
        origin, direction = pixel_rays(self._camera, width, height, x, y)
        for _ in range(BLENDED_MOST):
            surface = self._films.surface_along(self._camera, origin, direction, width, height)
            before = surface.valid & (~self.solid.valid | (surface.depth <= self.solid.depth * (1 + DECAL_DEPTH)))
            if not before.any():
                return
            cover = self._films.launched(_cover, origin, direction)
            direction = direction * before.reshape(-1, 1)  # what sees nothing here sees nothing beyond
            origin = origin + cover["beyond"][:, None].astype(np.float64) * direction
            columns = cover["opacity"], tints[cover["material"]]
            opacity, tint = (column.reshape(height, width, 1) * before[..., None] for column in columns)
            yield _masked(surface, before), opacity, (1 - opacity) * (1 + tint * (surface.albedo - 1))


def _behind(scene: Scene) -> Scene:
    """What of the scene is seen where nothing is blended: all but stand-ins, which are holes if nothing else is there.

    Left in as holes, they would still move what they lie on.
    """
    meshes = tuple(mesh for mesh in scene.meshes if not scene.materials[mesh.material].stand_in)
    if len(meshes) == len(scene.meshes):
        return scene
    return replace(scene, meshes=meshes or scene.meshes, materials=tuple(map(_hole, scene.materials)), blended=())


def _hole(material: Material) -> Material:
    """The material, all of it a hole if it is that of a stand-in."""
    return replace(material, filter=None, alpha_cutoff=np.inf) if material.stand_in else material


def _cut(material: Material) -> Material:
    """The material with holes where a frame blends nothing: a cutoff of 0 has none, but keeps the texture of alpha."""
    least = 0.0 if material.tint else ALPHA_MIN
    return replace(material, alpha_cutoff=max(material.alpha_cutoff or 0.0, least))


def _masked(surface: Surface, where: np.ndarray) -> Surface:
    """The surface in the pixels (H, W) bool `where`, and none in others."""
    deep = where[..., None]
    return Surface(**{name: array * (deep if array.ndim == 3 else where) for name, array in vars(surface).items()})


def _cover(tracer: Tracer, origin: np.ndarray, direction: np.ndarray) -> dict[str, np.ndarray]:
    """The opacity and the index of the material of what rays see, and where they go on `beyond` it, m; each (N,), 0 if
    it is nothing.

    The arguments are those of `paths.first_hits`.
    """
    o, d = mi.Point3f(origin.T), mi.Vector3f(direction.T)
    hit = closest_front(tracer, o, d, dr.squared_norm(d) > 0)
    found = dr.isfinite(hit.t)
    _, material, _ = side(tracer, hit, d, found)
    columns = {
        "opacity": dr.clip(tracer.shading.opacity(material, hit.prim, hit.b, found), 0, 1),
        "material": material,
        "beyond": beyond(tracer, o, d, hit.t, hit.prim, found),
    }
    columns = {name: dr.select(found, column, 0) for name, column in columns.items()}
    dr.eval(columns)
    return {name: np.array(column) for name, column in columns.items()}
