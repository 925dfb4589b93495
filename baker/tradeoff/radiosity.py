"""Radiosity: patches that light one another, and B at vertices."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.runtime import constants

from .gather import Gather
from .ground import Ground
from .lit_points import emitted, materials
from .method import Method
from .patched_surface import PatchedSurface
from .subdivision import subdivided
from .surface_hits import SurfaceHits

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.surface_light import SurfaceLight

PATCHES, PATCHES_QUICK = (1 << 10, 1 << 12, 1 << 14, 1 << 16), (1 << 10, 1 << 12, 1 << 14)

# Square of the longest edge, in mean areas of a patch. A right triangle with such an edge has 1.5 of them, and halving
# edges leaves triangles between a half of the largest and the whole.
EDGE = 6.0

POINTS, RAYS = 8, 32  # in each patch, and rays from each of them: its form factors
EMITTED_PATHS, EMITTED_PATHS_VERTEX = 32, 1024  # there and at vertices, for light from emitters and the environment
CONVERGED, ROUNDS = 1e-4, 200  # change of a round, relative to the light, and most rounds

AT_ONCE = 1 << 11  # patches or vertices
PULL = 0.25  # of the way to the middle of its triangles: there a vertex is lit, since walls meet at vertices
BACKS = 0.25  # share of hits on backs above which a vertex is buried and takes its neighbours' light

BYTES, ATTRIBUTES, INDICES = 6, 32, 12  # of a vertex's light, of its position, normal and coordinates; of a triangle


@dataclass(frozen=True)
class Radiosity:
    """B at the vertices of the scene with edges of at most `longest` m, all meshes one after another.

    position (V, 3) float32, m; triangle (F, 3) int64; light (V, 3) float16, linear radiance. `vertices` and `triangles`
    are the numbers of those that the scene has itself.
    """

    longest: float
    position: np.ndarray
    triangle: np.ndarray
    light: np.ndarray
    vertices: int
    triangles: int

    @property
    def file_bytes(self) -> int:
        """The light in half floats: edges can be halved at loading."""
        return BYTES * len(self.light)

    @property
    def gpu_bytes(self) -> int:
        """The light in four half floats, and the vertices and triangles that are more than the scene's own."""
        more = ATTRIBUTES * (len(self.light) - self.vertices) + INDICES * (len(self.triangle) - self.triangles)
        return 8 * len(self.light) + more

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) at points (N, 3) on surfaces with unit normals (N, 3); 0 where there is no surface."""
        found, triangle, weight = self._surface.at(position, normal)
        light = np.zeros((len(position), 3), np.float32)
        light[found] = (weight[..., None] * self.light[self.triangle[triangle]]).sum(axis=1)
        return light

    def light_pass(self, frame: "Frame", scale: int) -> "SurfaceLight":
        """An attribute that the G-buffer pass interpolates."""
        from .gl.radiosity_light import radiosity_light

        return radiosity_light(frame, self)

    @cached_property
    def _surface(self) -> SurfaceHits:
        return SurfaceHits(self.position, self.triangle)


def bake(ground: Ground, value: float, progress: Progress) -> Radiosity:
    """Solve for about `value` patches, and gather their light at the vertices of as small triangles."""
    with progress.stage("mesh"):
        longest = float(np.sqrt(EDGE * ground.plan.triangles.area / value))
        surface = PatchedSurface(subdivided(ground.scene, longest))
        patch = surface.patches(int(value))
    with progress.stage("form factors", int(patch.max()) + 1, "patches") as advance:
        albedo, direct, seen = _form_factors(ground, surface, patch, advance)
    with progress.stage("solve"):
        radiance = solved(albedo, direct, seen)
    with progress.stage("vertices", len(surface.position), "vertices") as advance:
        light = _at_vertices(ground, surface, radiance[patch], advance)
    own = (sum(len(getattr(mesh, name)) for mesh in ground.scene.meshes) for name in ("position", "triangle"))
    return Radiosity(longest, surface.position, surface.triangle, light, *own)


def solved(albedo: np.ndarray, direct: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The radiance (P, 3) that patches reflect, by Jacobi's method, until a round changes it by no more than CONVERGED.

    albedo (P, 3); direct (P, 3) is the light that reaches them from lights, over pi; seen (P, R) int are the patches
    that equally important rays meet, or P where they meet none.
    """
    from scipy.sparse import csr_array

    (patches, rays), columns = seen.shape, len(albedo) + 1
    ends = np.arange(0, patches * rays + 1, rays)
    form_factors = csr_array((np.full(seen.size, 1 / rays), seen.reshape(-1), ends), shape=(patches, columns))[:, :-1]
    radiance = albedo * direct
    for _ in range(ROUNDS):
        before, radiance = radiance, albedo * (direct + form_factors @ radiance)
        if np.abs(radiance - before).sum() <= CONVERGED * radiance.sum():
            break
    return radiance


def _form_factors(ground: Ground, surface: PatchedSurface, patch: np.ndarray, advance) -> tuple[np.ndarray, ...]:
    """Albedo (P, 3) and direct light (P, 3) of patches, and the patches (P, R) that rays from them meet, P for none."""
    rng = np.random.default_rng(ground.settings.seed)
    count = int(patch.max()) + 1
    order = np.argsort(patch, kind="stable")
    below = np.cumsum(surface.area[order])
    ends = below[np.searchsorted(patch[order], np.arange(count), side="right") - 1]
    starts = np.concatenate([[0.0], ends[:-1]])
    patch_of = np.append(patch, [count, count])  # a ray without a triangle has the number -1 or -2
    found = []
    for first in range(0, count, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        at = (np.arange(POINTS) + rng.random((len(ends[some]), POINTS))) / POINTS
        at = (starts[some, None] + (ends - starts)[some, None] * at).reshape(-1)
        triangle = order[np.minimum(np.searchsorted(below, at, side="right"), len(order) - 1)]
        position, normal = surface.inside(triangle, rng), surface.face[triangle]
        albedo, _, there = materials(ground, position, normal)
        direct = ground.cold.tracer.direct(position, normal, normal, dims=True)
        direct = direct + emitted(ground, position, normal, EMITTED_PATHS, first)
        seen, _ = surface.seen(position, normal, RAYS, rng)
        shape = -1, POINTS, 3
        found.append((
            (albedo * there[:, None]).reshape(shape).mean(axis=1), direct.reshape(shape).mean(axis=1),
            patch_of[seen].reshape(-1, POINTS * RAYS),
        ))  # fmt: skip
        advance(len(ends[some]))
    return tuple(np.concatenate(columns) for columns in zip(*found, strict=True))


def _at_vertices(ground: Ground, surface: PatchedSurface, radiance: np.ndarray, advance) -> np.ndarray:
    """B (V, 3) float16 at the vertices, from the radiance (F, 3) of triangles. Buried ones take that of neighbours."""
    rng = np.random.default_rng(ground.settings.seed)
    position = surface.position + PULL * surface.inwards()
    gather = Gather(surface, radiance)
    light, buried = np.zeros((len(position), 3)), np.zeros(len(position), bool)
    for first in range(0, len(position), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        at, normal = position[some], surface.normal[some]
        gathered, backs = gather.at(at, normal, rng)
        light[some] = gathered + emitted(ground, at, normal, EMITTED_PATHS_VERTEX, first)
        buried[some] = backs > BACKS
        advance(len(at))
    edges = np.concatenate([surface.triangle[:, [i, (i + 1) % 3]] for i in range(3)])
    edges = np.concatenate([edges, edges[:, ::-1]])
    while buried.any():
        reaching = edges[buried[edges[:, 0]] & ~buried[edges[:, 1]]]
        if not len(reaching):
            break
        number = np.bincount(reaching[:, 0], minlength=len(light))
        sums = np.stack([np.bincount(reaching[:, 0], light[reaching[:, 1], i], len(light)) for i in range(3)], axis=1)
        light = np.where(number[:, None] > 0, sums / np.maximum(number, 1)[:, None], light)
        buried &= number == 0
    return np.clip(light, 0, constants.HALF_MAX).astype(np.float16)


def patches(ground: Ground) -> list[float]:
    """Numbers of patches."""
    return [float(count) for count in (PATCHES_QUICK if ground.quick else PATCHES)]


METHOD = Method(
    "radiosity", "radiosity", "Goral et al. 1984; Wallace et al. 1989; Reichert 1992",
    "Form factors by rays to the scene's own triangles, solved by Jacobi's method, gathered once more at vertices.",
    "patches", Radiosity, patches, bake,
)  # fmt: skip
