"""Radiosity: patches that light one another, and B at vertices."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.baker.trace.point_order import signed_axis
from gsgi.runtime import constants
from gsgi.runtime.scene import Scene

from .ground import Ground
from .lit_points import emitted, materials
from .method import Method
from .subdivision import subdivided
from .surface_hits import SurfaceHits

if TYPE_CHECKING:
    from .gl.frame import Frame
    from .gl.surface_light import SurfaceLight

PATCHES, PATCHES_QUICK = (1 << 10, 1 << 12, 1 << 14, 1 << 16), (1 << 10, 1 << 12, 1 << 14)

# Square of the longest edge, in mean areas of a patch. A right triangle with such an edge has 1.5 of them, and halving
# edges leaves triangles between a half of the largest and the whole.
EDGE = 6.0
FINER = 2  # times as many triangles as patches are asked for: with more, several make a patch

POINTS, RAYS = 8, 32  # in each patch, and rays from each of them: its form factors
VERTEX_RAYS = 256  # from each vertex, and as many again to where the light is
EMITTED_PATHS, EMITTED_PATHS_VERTEX = 32, 1024  # at these, for light straight from emitters and the environment
CONVERGED, ROUNDS = 1e-4, 200  # change of a round, relative to the light, and most rounds

AT_ONCE = 1 << 11  # patches or vertices
LIFT = 1e-5  # of the diagonal; rays start so far above their surface
SHORT = 0.999  # of the way to a place that is seen no surface is met
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


class _Surface:
    """All triangles of a scene: position (V, 3), normal (V, 3), triangle (F, 3) int64, double_sided (F,) bool."""

    def __init__(self, scene: Scene):
        meshes = scene.meshes
        first = np.cumsum([0, *(len(mesh.position) for mesh in meshes)])
        self.position, self.normal = (np.concatenate([getattr(m, n) for m in meshes]) for n in ("position", "normal"))
        self.triangle = np.concatenate([m.triangle.astype(np.int64) + at for m, at in zip(meshes, first, strict=False)])
        counts = [len(mesh.triangle) for mesh in meshes]
        self.double_sided = np.repeat([scene.materials[mesh.material].double_sided for mesh in meshes], counts)
        corners = self.position[self.triangle].astype(np.float64)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        self.area = length[:, 0] / 2
        self.face = (cross / np.maximum(length, 1e-30)).astype(np.float32)
        self.middle = corners.mean(axis=1)
        self.lift = np.float32(LIFT * np.linalg.norm(np.ptp(self.position, axis=0)))

    @cached_property
    def hits(self) -> SurfaceHits:
        """For casting rays."""
        return SurfaceHits(self.position, self.triangle)

    def patches(self, count: int) -> np.ndarray:
        """The patch (F,) of each triangle: itself, or with many more than `count` those nearby that face alike."""
        if len(self.triangle) <= FINER * count:
            return np.arange(len(self.triangle))
        cell = np.floor(self.middle / np.sqrt(self.area.sum() / count)).astype(np.int64)
        keys = np.concatenate([cell, signed_axis(self.face)[:, None]], axis=1)
        return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)

    def inside(self, triangle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """A random point (N, 3) float32 in each of the triangles (N,)."""
        a, b, c = self.position[self.triangle[triangle]].transpose(1, 0, 2).astype(np.float64)
        root, v = np.sqrt(rng.random((len(triangle), 1))), rng.random((len(triangle), 1))
        return (a + root * (1 - v) * (b - a) + root * v * (c - a)).astype(np.float32)

    def inwards(self) -> np.ndarray:
        """From each vertex to the middle of its triangles (V, 3) float32, m, but never below the surface there.

        The middle of the triangles of a round body lies within it.
        """
        corner, repeated = self.triangle.reshape(-1), np.repeat(self.middle, 3, axis=0)
        number = np.bincount(corner, minlength=len(self.position))
        sums = [np.bincount(corner, column, len(self.position)) for column in repeated.T]
        way = np.stack(sums, axis=1) / np.maximum(number, 1)[:, None] - self.position
        below = np.minimum((way * self.normal).sum(axis=1, keepdims=True), 0)
        return ((way - below * self.normal) * (number > 0)[:, None]).astype(np.float32)

    def seen(
        self, position: np.ndarray, normal: np.ndarray, rays: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """The triangles (N, rays) that `rays` rays from points (N, 3) meet, with the density of the cosine, and where.

        They are -1 where a ray meets none, and -2 where it meets the back of a single-sided one; the places
        (N, rays, 3) are those of the points there. Each point has an even pattern of directions, turned and shifted at
        random.
        """
        around, across = rng.random((2, len(position), 1))
        u = (np.arange(rays) + 0.5) / rays
        angle = 2 * np.pi * ((np.arange(rays) * (np.sqrt(5) - 1) / 2 + around) % 1)
        radius = np.sqrt((u + across / rays - 0.5 / rays) % 1)
        tangent, bitangent = _frame(normal.astype(np.float64))
        up = np.sqrt(1 - radius * radius)[..., None] * normal[:, None]
        direction = (radius * np.cos(angle))[..., None] * tangent[:, None]
        direction += (radius * np.sin(angle))[..., None] * bitangent[:, None] + up
        origin = np.repeat(position + self.lift * normal, rays, axis=0)
        found, triangle, weight, back = self.hits.first(origin, direction.reshape(-1, 3))
        seen, place = np.full(len(found), -1), origin.astype(np.float64)
        seen[found] = np.where(back & ~self.double_sided[triangle], -2, triangle)
        place[found] = (weight[..., None] * self.position[self.triangle[triangle]]).sum(axis=1)
        return seen.reshape(-1, rays), place.reshape(-1, rays, 3)


class _Gather:
    """Gathers the radiance (F, 3) of the triangles of `surface`.

    Half of the rays have the density of the cosine, and half end at points chosen by their light, which finds what is
    small and bright; both are weighed by the balance heuristic (Veach 1995).
    """

    def __init__(self, surface: _Surface, radiance: np.ndarray):
        self._surface, self._radiance = surface, radiance
        power = radiance.mean(axis=1) * surface.area
        self._below = np.cumsum(power)
        self._density = radiance.mean(axis=1) / max(self._below[-1], 1e-30)  # of chosen points, per m^2

    def at(self, position: np.ndarray, normal: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """B (N, 3) at points (N, 3) with unit normals (N, 3), and the share (N,) of rays that meet backs."""
        shape = len(position), VERTEX_RAYS
        seen, place = self._surface.seen(position, normal, VERTEX_RAYS, rng)
        light = self._weighed(position, normal, seen, place)
        u = (np.arange(VERTEX_RAYS) + rng.random(shape)) / VERTEX_RAYS * self._below[-1]
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
        return (weight[..., None] * self._radiance[seen]).sum(axis=1) / VERTEX_RAYS


def bake(ground: Ground, value: float, progress: Progress) -> Radiosity:
    """Solve for about `value` patches, and gather their light at the vertices of as small triangles."""
    with progress.stage("mesh"):
        longest = float(np.sqrt(EDGE * ground.plan.triangles.area / value))
        surface = _Surface(subdivided(ground.scene, longest))
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


def _form_factors(ground: Ground, surface: _Surface, patch: np.ndarray, advance) -> tuple[np.ndarray, ...]:
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
        direct = ground.cold.tracer.direct(position, normal, normal)
        direct = direct + emitted(ground, position, normal, EMITTED_PATHS, first)
        seen, _ = surface.seen(position, normal, RAYS, rng)
        shape = -1, POINTS, 3
        found.append((
            (albedo * there[:, None]).reshape(shape).mean(axis=1), direct.reshape(shape).mean(axis=1),
            patch_of[seen].reshape(-1, POINTS * RAYS),
        ))  # fmt: skip
        advance(len(ends[some]))
    return tuple(np.concatenate(columns) for columns in zip(*found, strict=True))


def _at_vertices(ground: Ground, surface: _Surface, radiance: np.ndarray, advance) -> np.ndarray:
    """B (V, 3) float16 at the vertices, from the radiance (F, 3) of triangles. Buried ones take that of neighbours."""
    rng = np.random.default_rng(ground.settings.seed)
    position = surface.position + PULL * surface.inwards()
    gather = _Gather(surface, radiance)
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


def _frame(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (N, 3) perpendicular to normals (N, 3) and to each other."""
    up = np.where(np.abs(normal[:, 1:2]) < 0.9, [[0.0, 1, 0]], [[1.0, 0, 0]])
    tangent = np.cross(up, normal)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return tangent, np.cross(normal, tangent)


def patches(ground: Ground) -> list[float]:
    """Numbers of patches."""
    return [float(count) for count in (PATCHES_QUICK if ground.quick else PATCHES)]


METHOD = Method(
    "radiosity", "radiosity", "Goral et al. 1984; Wallace et al. 1989; Reichert 1992",
    "Form factors by rays to the scene's own triangles, solved by Jacobi's method, gathered once more at vertices.",
    "patches", Radiosity, patches, bake,
)  # fmt: skip
