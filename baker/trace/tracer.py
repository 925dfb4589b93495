"""B, the demodulated indirect light, in camera views and at surface points.

`B(x) = (1/pi) * integral of L_in(x, w) cos(theta) dw` (Kajiya 1986, "The rendering equation") without the light that
reaches x directly from a punctual light. B contains all light from emissive surfaces, including their direct light.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from gsgi.runtime.camera import Camera
from gsgi.runtime.metals import lambertian
from gsgi.runtime.scene import Scene

from .device import device
from .irradiance_cache import IrradianceCache, KnownLight
from .lit_places import LIGHTS_MOST
from .planes import onto_planes
from .point_order import coherent
from .punctual_lights import PunctualLights
from .surface_tables import corners_of, rows_with
from .visible import Surface, pixel_rays, surface_of

if TYPE_CHECKING:
    from .learned_lights import FoundCell, LearnedLights

# Paths per point and points of one launch. On a CPU the number of points is fixed, as Dr.Jit recompiles for any other
# number. A GPU takes any, and needs many at once.
PASS_SAMPLES = 32
LAUNCH_POINTS = 1 << 14
LAUNCH_POINTS_GPU = 1 << 18
RUN = 32  # points whose lanes follow each other: no fewer than a core computes at once

PRIOR_SAMPLES = 64

# Default number of bounces: Russian roulette ends paths much earlier. At albedo 0.99 this cuts off 3e-5 of the light.
BOUNCES_MAX = 1024


@dataclass(frozen=True)
class Sampling:
    """How long points are traced: at most `samples` paths (in passes of PASS_SAMPLES) of at most `bounces` surfaces.

    A point is done earlier once its standard error is at most `error` * (B + `scale`), with `scale` in radiance: a
    relative error where B is bright, an absolute one where it is dark. With `error` 0 no point is done earlier.
    """

    samples: int
    bounces: int = BOUNCES_MAX
    error: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class Light:
    """B at N points.

    mean (N, 3) float32 is linear Rec.709 radiance; error (N,) float32 is the standard error of its channel mean;
    samples (N,) int64 counts the paths that gave a finite number; invalid is the number of all others, left out.
    """

    mean: np.ndarray
    error: np.ndarray
    samples: np.ndarray
    invalid: int


@dataclass(frozen=True)
class LightByBounces:
    """B at N points in `light`, and the part of it that comes by at most 0, 1, ... K bounces: `within` (K + 1, N, 3)
    float32, which paths of at most so many bounces would give, but for rounding. asked (N, 3) float32 is what
    `Tracer.asked_through_filters` tells of the points."""

    light: Light
    within: np.ndarray
    asked: np.ndarray


class Tracer:
    """Traces the light of one scene. Results depend only on the arguments, not on threads or earlier calls."""

    recall: "Callable[[Tracer], LearnedLights | None] | None" = None  # learns about the lights, or knows them already

    def __init__(self, scene: Scene):
        from .emitters import Emitters
        from .environment_light import EnvironmentLight
        from .instances import surfaces_of
        from .places import Places
        from .shading import Shading

        self._scene = scene = lambertian(scene)
        surfaces, moved = surfaces_of(scene)
        self.corners = partial(corners_of, surfaces.position, surfaces.triangle, surfaces.placed)
        self.rows_with = partial(rows_with, surfaces.position, surfaces.triangle[: surfaces.single])
        self.places = Places(surfaces)
        self.opaque, self.masked, self.filtering = self.places.trees
        self.unlit = any(material.unlit for material in scene.materials)
        self.shading = Shading(surfaces, moved, self.places)
        self.lights = PunctualLights(scene.lights, *scene.bounds())
        self.emitters = Emitters(scene, surfaces)
        self.environment = None if scene.environment is None else EnvironmentLight(scene.environment)

    def lit_by(self, scene: Scene) -> "Tracer":
        """A tracer of B in `scene`, which is this one's with fewer lights. Both share the surfaces."""
        from .emitters import Emitters
        from .environment_light import EnvironmentLight
        from .instances import surfaces_of

        other = copy(self)
        for name in ("cells", "recall"):
            vars(other).pop(name, None)
        other.lights = PunctualLights(scene.lights, *scene.bounds())
        other.environment = None if scene.environment is None else EnvironmentLight(scene.environment)
        if self.emitters.count:  # their tables are made again: kept, they would hold all triangles twice
            other.emitters = Emitters(scene, surfaces_of(self._scene)[0])
        return other

    @cached_property
    def cells(self) -> "FoundCell | None":
        """Where which lights are likely to matter; None if there is nothing to choose."""
        from .learned_lights import learn, use

        learned = (self.recall or learn)(self)
        return learned and use(self, learned)

    def surface(self, camera: Camera, width: int, height: int) -> Surface:
        """The surfaces seen through the pixel centres of an image of this size (px)."""
        return next(self.surfaces([camera], width, height))

    def surfaces(
        self, cameras: Sequence[Camera], width: int, height: int, by_chance: bool = False
    ) -> Iterator[Surface]:
        """The same for each of the cameras; those of small images share launches.

        They see through what is mostly clear, or, `by_chance`, through anything that lets light pass as often as it
        does.
        """
        together = max(LAUNCH_POINTS // (width * height), 1)
        y, x = (np.mgrid[0:height, 0:width] + 0.5).reshape(2, -1)
        for first in range(0, len(cameras), together):
            some = cameras[first : first + together]
            rays = [pixel_rays(camera, width, height, x, y) for camera in some]
            hits = self._first_hits(*(np.concatenate(part) for part in zip(*rays, strict=True)), by_chance)
            for camera, *columns in zip(some, *(np.split(c, len(some)) for c in hits.values()), strict=True):
                yield surface_of(camera, dict(zip(hits, columns, strict=True)), width, height)

    def surface_along(self, camera: Camera, origin, direction, width: int, height: int) -> Surface:
        """The surface seen along rays through all pixel centres, in rows, which may start beyond the camera.

        Their origins are (height * width, 3), m, and so are their unit directions; a direction of 0 sees nothing.
        """
        return surface_of(camera, self._first_hits(origin, direction), width, height)

    def seen(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, ...]:
        """What cameras see along rays from `origin` (N, 3) along unit `direction` (N, 3), as `Surface` describes it:
        through what lets light pass, as often as it does.

        Position, normal, shading_normal and geometric_normal (N, 3) float32, and where (N,) bool the ray meets a
        diffuse surface.
        """
        hits = self._first_hits(origin, direction, by_chance=True)
        names = "position", "normal", "shading_normal", "geometric_normal"
        return *(hits[name] for name in names), hits["valid"] & hits["diffuse"]

    def indirect(
        self, position, normal, geometric_normal, sampling: Sampling, seed: int, advance=None,
        known: IrradianceCache | None = None, numbers: np.ndarray | None = None,
    ) -> Light:  # fmt: skip
        """B at surface points: position (N, 3) m, normal and geometric_normal (N, 3) unit, all float32, world space.

        Paths end at the first surface whose B is `known`, with the bounces that it was traced with. The same arguments
        give bit-identical results. `advance(points)` is called as points finish, N in total.

        `numbers` (N, 2) uint32 has the number of each point and that of its first path; without it, points are numbered
        from 0, and so are paths. A path depends only on the seed, its point and its numbers. The paths of a point cover
        its directions evenly, however many calls trace them, if each call goes on in their numbers.
        """
        return self._sums((position, normal, geometric_normal), sampling, seed, advance, known, numbers).light()

    def by_bounces(
        self, position, normal, geometric_normal, sampling: Sampling, seed: int, most: int
    ) -> LightByBounces:
        """The light of `indirect`, and what of it comes by at most 0, 1, ... `most` bounces."""
        sums = self._sums((position, normal, geometric_normal), sampling, seed, apart=most + 1)
        within = sums.apart.cumsum(axis=1).transpose(1, 0, 2) / np.maximum(sums.samples, 1)[:, None]
        asked = self.asked_through_filters(position, normal)
        return LightByBounces(sums.light(), within.astype(np.float32), asked)

    def _sums(
        self, points, sampling: Sampling, seed: int, advance=None, known=None, numbers=None, apart: int = 0
    ) -> "_Sums":
        """The sums of `indirect`, with those of light by fewer than `apart` bounces."""
        count = len(points[0])
        known = None if known is None else known.on_device
        if numbers is None:
            numbers = np.stack([np.arange(count), np.zeros(count)], axis=1).astype(np.uint32)
        passes = -(-sampling.samples // PASS_SAMPLES)
        # Of few points, passes that depend on no other share launches.
        together = 1 if sampling.error else min(max(launch_points(count) // max(count, 1), 1), passes)
        sums = _Sums.empty(count, apart)
        active = coherent(*points[:2])  # neighbours meet the same surfaces: a tenth faster among many triangles
        for k in range(0, passes, together):
            step = advance and (lambda n: advance(n / passes))
            these = np.arange(k, min(k + together, passes), dtype=np.uint32)
            at = np.tile(active, len(these))
            going_on = numbers[at]
            going_on[:, 1] += PASS_SAMPLES * np.repeat(these, len(active))
            self._pass([column[at] for column in points], at, going_on, sums, sampling.bounces, known, seed, step)
            if not sampling.error:
                continue
            going = active[sums.error()[active] > sampling.error * (sums.brightness()[active] + sampling.scale)]
            if advance:
                advance((len(active) - len(going)) * (passes - 1 - k) / passes)
            active = going
        return sums

    def halves(
        self, position, normal, geometric_normal, sampling: Sampling, seed, advance=None,
        known: KnownLight | None = None, numbers: np.ndarray | None = None,
    ) -> tuple[Light, Light]:  # fmt: skip
        """B twice, from independent paths: `indirect` with seeds made from `seed`, and `known` light."""
        ends = (None, None) if known is None else (known.a, known.b)
        seeds = np.random.SeedSequence(seed).generate_state(2).tolist()
        where = position, normal, geometric_normal, sampling
        return tuple(self.indirect(*where, s, advance, end, numbers) for s, end in zip(seeds, ends, strict=True))

    def blocked(self, origin: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Whether a surface is between points (N, 3) and others (N, 3), m: (N,) bool. Points must be off surfaces."""
        from . import paths

        return self.launched(paths.blocked, origin, target)["blocked"]

    def direct(self, position, normal, geometric_normal, dims: bool = False) -> np.ndarray:
        """Direct light of the punctual lights: (N, 3) float32, such that primary = albedo * direct + emission.

        The arguments are those of `indirect`, with the shading normal. The result is exact: every light gets a shadow
        ray, and the lights have no extent. Clear panes let light through undimmed, as frames do, or, with `dims`, as
        much of it as goes on from the points.
        """
        from . import paths

        if not self.lights.count:
            return np.zeros((len(position), 3), np.float32)
        kernel = partial(paths.punctual, filtered=False, dims=dims)
        return self.launched(kernel, position, normal, geometric_normal)["light"]

    @property
    def asks_through_filters(self) -> bool:
        """Whether paths that end in known light ask there for light of punctual lights that has passed filters.

        Known light lacks what is `asked_through_filters`, which would take too long to find for many lights.
        """
        return self.filtering is not None and 0 < self.lights.count <= LIGHTS_MOST

    def asked_through_filters(self, position, normal) -> np.ndarray:
        """The part (N, 3) float32 of B that punctual lights bring through filters, 0 where paths do not ask for it.

        The arguments are those of `indirect`. The part is exact, as `direct` is.
        """
        if not self.asks_through_filters:
            return np.zeros((len(position), 3), np.float32)
        return self.through_filters(position, normal, normal)

    def through_filters(self, position, normal, geometric_normal) -> np.ndarray:
        """The same part of B, whether or not paths ask for it."""
        from . import paths

        if self.filtering is None or not self.lights.count:
            return np.zeros((len(position), 3), np.float32)
        kernel = partial(paths.punctual, filtered=True, dims=True)
        return self.launched(kernel, position, normal, geometric_normal)["light"]

    def _first_hits(self, origin: np.ndarray, direction: np.ndarray, by_chance: bool = False) -> dict[str, np.ndarray]:
        """The columns of `paths.first_hits`, with `position` in place of triangle and distance."""
        from . import paths

        hits = self.launched(partial(paths.first_hits, by_chance=by_chance), origin, direction)
        met = origin + hits.pop("distance")[:, None].astype(np.float64) * direction
        return hits | {"position": onto_planes(met, self.corners(hits.pop("triangle")))}

    def launched(self, kernel: Callable, *inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Columns (N, ...) of a kernel that takes arrays (N, 3), computed in launches of one size."""
        launches = []
        most = launch_points(len(inputs[0]))
        for first in range(0, max(len(inputs[0]), 1), most):
            some = [array[first : first + most] for array in inputs]
            lanes = _lanes(len(some[0]), most)
            columns = kernel(self, *(_padded(array, lanes, most) for array in some))
            launches.append({name: column[lanes] for name, column in columns.items()})
        return {name: np.concatenate([launch[name] for launch in launches]) for name in launches[0]}

    def _pass(self, points, at, numbers, sums: "_Sums", bounces: int, known, seed: int, advance) -> None:
        """Trace PASS_SAMPLES more paths from each of the `points`, and add them to `sums` at the rows `at`."""
        from . import paths

        seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
        most = launch_points(len(at))
        for first in range(0, len(at), most):
            some = slice(first, first + most)
            lanes = _lanes(len(at[some]), most)
            padded = [_padded(array[some], lanes, most) for array in (*points, numbers)]
            launch = paths.indirect(self, *padded, PASS_SAMPLES, bounces, seed, known, sums.apart.shape[1])
            sums.add(at[some], paths.Sums(*(column[lanes] for column in launch)))
            if advance:
                advance(len(at[some]))


@dataclass(frozen=True)
class _Sums:
    """Running sums over the paths of N points."""

    total: np.ndarray  # (N, 3)
    squared: np.ndarray  # (N,) of the mean of the channels
    samples: np.ndarray  # (N,)
    invalid: np.ndarray  # (N,)
    apart: np.ndarray  # (N, K, 3), by fewer than K bounces

    @staticmethod
    def empty(count: int, apart: int) -> "_Sums":
        counts = np.zeros(count, np.int64), np.zeros(count, np.int64)
        return _Sums(np.zeros((count, 3)), np.zeros(count), *counts, np.zeros((count, apart, 3)))

    def add(self, at: np.ndarray, launch) -> None:
        """Add the sums of a launch for the points `at`, which may be there more than once."""
        np.add.at(self.total, at, launch.light)
        np.add.at(self.squared, at, launch.squared)
        np.add.at(self.samples, at, PASS_SAMPLES - launch.invalid)
        np.add.at(self.invalid, at, launch.invalid)
        np.add.at(self.apart, at, launch.apart)

    def brightness(self) -> np.ndarray:
        """Channel mean (N,) of B."""
        return self.total.mean(axis=1) / np.maximum(self.samples, 1)

    def error(self) -> np.ndarray:
        """Standard error of the brightness (N,).

        The mean variance over all points acts as a prior that weighs as much as PRIOR_SAMPLES paths, because a few
        paths that all missed a small light do not show its variance.
        """
        n = np.maximum(self.samples, 1)
        variance = np.maximum(self.squared / n - self.brightness() ** 2, 0)
        pooled = (variance * n + variance.mean() * PRIOR_SAMPLES) / (n + PRIOR_SAMPLES) if len(n) else variance
        return np.sqrt(pooled / n)

    def light(self) -> Light:
        mean = self.total / np.maximum(self.samples, 1)[:, None]
        counts = self.samples, int(self.invalid.sum())
        return Light(mean.astype(np.float32), self.error().astype(np.float32), *counts)


def launch_points(count: int) -> int:
    """Points of each launch of a task with so many."""
    if device() == "cpu":
        return LAUNCH_POINTS
    return min(max(LAUNCH_POINTS, 1 << (count - 1).bit_length()), LAUNCH_POINTS_GPU)


def _lanes(count: int, launch: int) -> np.ndarray:
    """The lanes (count,) of a launch that trace as many points: spread over all in runs of RUN, in order.

    Each core takes lanes that follow each other, and all cores are to have as many of these points.
    """
    run, within = np.divmod(np.arange(count), RUN)
    return run * (launch // RUN) // max(-(-count // RUN), 1) * RUN + within


def _padded(array: np.ndarray, lanes: np.ndarray, launch: int) -> np.ndarray:
    """The rows of an array (n, C) at these `lanes` of a launch, and zeros at the others.

    Integers are kept, all else becomes float32. Nothing is traced for a normal or direction of 0.
    """
    kind = array.dtype if array.dtype == np.uint32 else np.float32
    result = np.zeros((launch, array.shape[1]), kind)
    result[lanes] = array
    return result
