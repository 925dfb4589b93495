"""The error of the renderer's primary light against the path tracer's, away from edges."""

from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.trace.tracer import Tracer
from gsgi.baker.trace.visible import Surface
from gsgi.runtime.camera import Camera
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gl.shadow import faces_of
from gsgi.runtime.scene import Light, Scene

REACH = 3  # texels of a shadow map, for its filter, the offset along the normal and that towards the light


@dataclass(frozen=True)
class PrimaryError:
    """The `drawn` and the `traced` primary light (H, W, 3), radiance.

    `counts` (H, W) marks pixels away from edges of surfaces, without a shadow edge of the path tracer within REACH
    texels. `lit` (H, W) marks those of them that have light.
    """

    drawn: np.ndarray
    traced: np.ndarray
    counts: np.ndarray
    lit: np.ndarray

    @property
    def pixels(self) -> np.ndarray:
        """Relative errors (N,) of the lit pixels, summed over the channels."""
        drawn, traced = self.drawn[self.lit], self.traced[self.lit]
        return np.abs(drawn - traced).sum(axis=-1) / traced.sum(axis=-1)

    @property
    def mean(self) -> float:
        """Mean of the lit pixels' relative errors."""
        return float(self.pixels.mean())

    @property
    def total(self) -> float:
        """Sum of all errors over the sum of all light. Light where there should be none counts as well."""
        difference = np.abs(self.drawn - self.traced)[self.counts].sum()
        return float(difference / self.traced[self.counts].sum())

    @property
    def wrong(self) -> float:
        """Share of the pixels whose error is more than a tenth of the brighter of the two."""
        drawn, traced = self.drawn[self.counts].sum(axis=-1), self.traced[self.counts].sum(axis=-1)
        return float((np.abs(drawn - traced) > 0.1 * np.maximum(drawn, traced)).mean())


def primary_error(gl, scene: Scene, camera: Camera, width: int, height: int) -> PrimaryError:
    """The error of one view at its pixel centres."""
    renderer = DeferredRenderer(gl, scene.as_traced(), None, width, height)
    renderer.render(camera)
    drawn = renderer.read("primary")
    renderer.release()
    tracer = Tracer(scene)
    surface = tracer.surface(camera, width, height)
    direct = surface.image(tracer.direct(*surface.shading_points()))
    traced = surface.emission + surface.albedo * direct
    counts = ~_surface_edges(surface)
    corners = np.stack(np.meshgrid(*np.transpose(scene.bounds())), axis=-1).reshape(8, 3)
    for light in scene.lights:
        counts &= ~surface.image(_near_shadow_edge(tracer, light, corners, surface))
    return PrimaryError(drawn, traced, counts, counts & traced.any(axis=-1))


def _near_shadow_edge(tracer: Tracer, light: Light, corners: np.ndarray, surface: Surface) -> np.ndarray:
    """Whether (N,) there are both lit and shadowed points within REACH texels of the shadow map of a diffuse point.

    `corners` (8, 3) are those of the scene's bounds. Replaces the lights of the tracer.
    """
    from gsgi.baker.trace.punctual_lights import PunctualLights

    position, _, normal = surface.points()
    towards = np.broadcast_to(-light.direction, position.shape)
    if light.kind != "directional":
        towards = light.position - position
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normal, across)
    faces = faces_of(light, corners)
    depth = np.abs(position @ faces.depth_from_world[:, :3].T + faces.depth_from_world[:, 3]).max(axis=1)
    step = REACH * (faces.texel_size[0] + faces.texel_size[1] * depth)[:, None]
    # The light has neither range nor cone, and surfaces face it wherever they are moved, so only its shadow is left.
    kind = "directional" if light.kind == "directional" else "point"
    low, high = corners.min(axis=0), corners.max(axis=0)
    tracer.lights = PunctualLights((replace(light, kind=kind, range=np.inf, color=np.ones(3)),), low, high)
    ways = 0 * normal, across, -across, along, -along, normal, towards, normal + towards
    around = np.concatenate([position + step * way for way in ways]).astype(np.float32)
    facing = [np.tile(n, (len(ways), 1)).astype(np.float32) for n in (towards, normal)]
    seen = tracer.direct(around, *facing).any(axis=-1).reshape(len(ways), -1)
    return seen.any(axis=0) & ~seen.all(axis=0)


def _surface_edges(surface: Surface) -> np.ndarray:
    """Pixels next to one that shows another surface: off the tangent plane, or with another normal."""
    n = surface.geometric_normal
    result = np.zeros_like(surface.valid)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        position, normal, valid = (np.roll(a, step, axis) for a in (surface.position, n, surface.valid))
        off = np.abs(((position - surface.position) * n).sum(axis=-1)) > 0.01 * surface.depth
        result |= (valid != surface.valid) | (surface.valid & (off | ((normal * n).sum(axis=-1) < 0.9)))
    return result
