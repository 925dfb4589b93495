"""The surfaces that a bake's cameras see, from which it draws the points of its samples."""

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gsgi.baker.cache.digest import digest
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.visible import pixel_rays
from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.directions import random_directions
from gsgi.baker.views.importance import ImportanceField
from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.views.visibility import COS_MIN
from gsgi.runtime.camera import Camera

from .contrast import Contrast
from .cut_off import Sight

SIZE = 64  # px, edge of the images that find surface points

# A camera that sees no light uses only every DARK_STEP-th pixel, and samples by area alone: enough to learn this. Of a
# hall with six hollow columns, half of the views were in these. With a fourth of the pixels, and all that people would
# look at there, they took a tenth of the samples, whose errors outweighed all others: the columns had stains. With
# every 64th pixel and a 64th of the looks, light leaked into a dark room beside a bright one.
DARK_STEP = 16

# In free space before such a camera, only every FREE_STEP-th of these pixels counts: what moves there is black, and the
# coarse level has few Gaussians to spend on it.
FREE_STEP = 4

# Range of points in free space, as shares of the line of sight from the camera to the surface.
FREE = 0.05, 0.95

AREA_SHARE = 1 / 2  # of the samples go by area, so that no surface is left without; the rest by importance
CONTRAST_SHARE = 1 / 2  # instead by importance and contrast, where the light's contrast is known
OUTSIDE_SHARE = 1 / 2  # of the points from which light comes into a box; they go by area
FREE_DRAWS = 32  # most times to draw points in a box from lines of sight that may pass beside it
MASS = 1 / 4, 4  # range of the share of the samples around a point of importance, relative to the mean of all points
CUT_OFF_SHARE = 1 / 16  # most of the samples that go where hardly any of those around sees them
CUT_OFF_TRIES, CUT_OFF_AROUND = 48, 4.0  # times that is tried around each that is there, within so many px
FOOTPRINT_QUANTILE = 0.999  # larger pixel footprints are cut to this


class SeenSurface:
    """Surface points behind the diffuse pixels of cameras, found when they are first needed.

    Points drawn from it are as dense as `importance` is, or evenly spread over each camera's visible area without it.
    With a box all of them lie in it.
    """

    def __init__(
        self,
        tracer: CachedTracer,
        cameras: Sequence[Camera],
        dark: Sequence[bool] = (),
        importance: ImportanceField | None = None,
        triangles: Triangles | None = None,
    ):
        """`dark` marks the cameras that see no light; if it is empty, all of them see light.

        The box is that of the `triangles`, which tell what is cut off: some of the points that are drawn go there.
        """
        self._tracer, self._cameras, self._importance, self._triangles = tracer, cameras, importance, triangles
        self._box = box = triangles.box if triangles else None
        self._steps = [DARK_STEP if is_dark else 1 for is_dark in dark or [False] * len(cameras)]
        self._outside, self._found = 0.0, []  # share of points outside the box; `_pixels`, which `around` shares
        known = {"cameras": cameras, "steps": self._steps, "importance": importance, "box": box}
        self.digest = digest(known | {"cut_off": triangles is not None})

    @cached_property
    def around(self) -> "SeenSurface":
        """The same surfaces, and those outside the box that the cameras see too: light comes from all of them."""
        if self._box is None:
            return self
        around = copy(self)
        around._outside = OUTSIDE_SHARE
        around.digest = digest({"inside": self.digest, "outside": OUTSIDE_SHARE})
        return around

    def shares(self, contrast: Contrast | None = None, before: np.ndarray | None = None) -> np.ndarray:
        """How many of the points that are drawn lie behind each pixel (P,): more where the light has `contrast`.

        That is what is left between neighbours among points that were drawn by the shares `before` (P,) of the surfaces
        `around`, which must be given with it: where those were denser already, these are denser by both factors. So
        each round comes closer to light that varies over a hand's breadth in a hall.
        """
        seen = self._pixels
        inside, outside = seen.inside * seen.share, ~seen.inside * seen.share
        if self._outside and inside.any() and outside.any():
            inside *= (1 - self._outside) / inside.sum()
            inside += outside * self._outside / outside.sum()
        if contrast is None:
            return inside
        even = self.around.shares()
        denser = np.divide(before, even, out=np.zeros_like(before), where=even > 0)
        varied = inside * contrast.around(seen.position, seen.normal) * denser
        if not varied.any():
            return inside
        return (1 - CONTRAST_SHARE) * inside + CONTRAST_SHARE * varied / varied.sum()

    def surface(self, count: int, rng: np.random.Generator, shares: np.ndarray) -> tuple[np.ndarray, ...]:
        """Points on surfaces, stratified by `shares` (P,).

        The result is what `behind` finds, camera (count,) int32 and place (count, 2) float64: the points lie anywhere
        behind their pixels, so that no two are the same.
        """
        seen = self._pixels
        if not shares.any():
            return _none()
        below = np.cumsum(shares, dtype=np.float64)
        at = (np.arange(count) + rng.random(count)) / count * below[-1]
        index = np.minimum(np.searchsorted(below, at, side="right"), len(seen.position) - 1)
        camera, place = seen.camera[index].astype(np.int32), seen.middle(index) + rng.uniform(-0.5, 0.5, (count, 2))
        *points, _ = self.behind(camera, place)
        drawn = *points, camera, place
        if self._triangles:
            self._move_to_cut_off(drawn, rng)
        return drawn

    def _move_to_cut_off(self, drawn: tuple[np.ndarray, ...], rng: np.random.Generator) -> None:
        """Move some of the points `drawn`, in the form of `surface`, to places that are cut off.

        These are looked for around the points that lie in such places, in the images of their cameras.
        """
        position, normal, *_, camera, place = drawn
        sight = Sight(position, normal, self._triangles)
        around = np.repeat(np.flatnonzero(sight.cut_off(position, normal, themselves=True)), CUT_OFF_TRIES)
        found = place[around] + rng.uniform(-CUT_OFF_AROUND, CUT_OFF_AROUND, (len(around), 2))
        inside = ((found >= 0) & (found < SIZE)).all(axis=1)
        if not inside.any():
            return
        camera, place = camera[around[inside]], found[inside]
        *points, diffuse = self.behind(camera, place)
        some = np.flatnonzero(diffuse & self.holds(points[0]))
        some = some[sight.cut_off(points[0][some], points[1][some])]
        some = rng.permutation(some)[: round(CUT_OFF_SHARE * len(position))]
        moved = rng.permutation(len(position))[: len(some)]
        for column, values in zip(drawn, (*points, camera, place), strict=True):
            column[moved] = values[some]

    def everywhere(self) -> tuple[np.ndarray, ...]:
        """The points behind the middles of all pixels that may be drawn from, in the form of `surface`."""
        seen = self._pixels
        index = np.flatnonzero(seen.inside)
        *points, camera = (column[index] for column in (*seen[:4], seen.camera))
        return *points, camera.astype(np.int32), seen.middle(index)

    def unlit(self) -> tuple[np.ndarray, np.ndarray]:
        """The positions and normals (N, 3) float32 behind all pixels of the cameras that see no light."""
        cameras = [camera for camera, step in zip(self._cameras, self._steps, strict=True) if step > 1]
        if not cameras:
            return _none()[:2]
        surfaces = self._tracer.tracer.surfaces(cameras, SIZE, SIZE)
        position, normal = map(np.concatenate, zip(*(surface.points()[:2] for surface in surfaces), strict=True))
        inside = in_box(self._box, position)
        return position[inside], normal[inside]

    def behind(self, camera: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, ...]:
        """What is seen at places (N, 2), px, of the images of cameras (N,).

        The result is position, normal, shading normal and geometric normal (N, 3) float32, and where (N,) bool that is
        a diffuse surface. The middle of a pixel stands for places where none is seen.
        """
        *points, diffuse = self._seen(camera, place)
        if (missed := np.flatnonzero(~diffuse)).size:
            *middles, diffuse[missed] = self._seen(camera[missed], np.floor(place[missed]) + 0.5)
            for column, middle in zip(points, middles, strict=True):
                column[missed] = middle
        return *points, diffuse

    def holds(self, position: np.ndarray) -> np.ndarray:
        """Which points (N, 3) on what the cameras see may be drawn from it, (N,) bool."""
        return in_box(None if self._outside else self._box, position)

    def eyes(self, camera: np.ndarray) -> np.ndarray:
        """The positions (N, 3), m, of cameras (N,)."""
        return np.array([each.position for each in self._cameras]).reshape(-1, 3)[camera]

    def _seen(self, camera: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, ...]:
        """The same without a stand-in."""
        order = np.argsort(camera, kind="stable")
        runs = _runs(camera[order])
        rays = [pixel_rays(self._cameras[number], SIZE, SIZE, *place[order[here]].T) for number, here in runs]
        found = self._tracer.tracer.seen(*(np.concatenate(part) for part in zip(*rays, strict=True)))
        columns = tuple(np.empty_like(column) for column in found)
        for column, values in zip(columns, found, strict=True):
            column[order] = values
        return columns

    def free(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        """Points on lines of sight to surface points, with uniform random directions as all three normals.

        The result is that of `surface`, with the camera and place from which the line of sight comes.
        """
        seen, found = self._pixels, 0
        dark = np.array(self._steps)[seen.camera] > 1
        before = np.concatenate([np.flatnonzero(~dark), np.flatnonzero(dark)[::FREE_STEP]])
        parts, lines = [np.empty((0, 3))], [np.empty(0, np.int64)]
        for _ in range(FREE_DRAWS if len(before) else 0):
            index = before[rng.integers(len(before), size=count)]
            way = rng.uniform(*FREE, (count, 1))
            position = seen.viewpoint[index] + way * (seen.position[index] - seen.viewpoint[index])
            inside = in_box(self._box, position)
            parts.append(position[inside])
            lines.append(index[inside])
            found += len(parts[-1])
            if found >= count:
                break
        position, index = np.concatenate(parts)[:count], np.concatenate(lines)[:count]
        normal = random_directions(len(position), rng).astype(np.float32)
        camera = seen.camera[index].astype(np.int32)
        return position.astype(np.float32), normal, normal, normal, camera, seen.middle(index)

    @property
    def _pixels(self) -> "_Pixels":
        if not self._found:
            self._found.append(self._find())
        return self._found[0]

    def _find(self) -> "_Pixels":
        columns = []
        surfaces = self._tracer.tracer.surfaces(self._cameras, SIZE, SIZE, by_chance=True)
        for number, (camera, step, surface) in enumerate(zip(self._cameras, self._steps, surfaces, strict=True)):
            position, normal, geometric = surface.points()
            shading = surface.shading_points()[1]
            depth = surface.depth[surface.diffuse].astype(np.float64)
            above = np.abs(((camera.position - position) * geometric).sum(axis=1))  # of the camera over the surface
            area = depth**3 / np.maximum(above, np.finfo(np.float32).tiny) / camera.pinhole(SIZE, SIZE).fx ** 2
            eye = np.broadcast_to(camera.position.astype(np.float32), position.shape)
            upright = above >= COS_MIN * np.linalg.norm(camera.position - position, axis=1)
            pixel = np.flatnonzero(surface.diffuse)
            of = np.full(len(pixel), number), pixel
            lit = np.full(len(pixel), step == 1)
            columns.append([c[::step] for c in (position, normal, shading, geometric, eye, *of, area, upright, lit)])
        *arrays, area, upright, lit = (np.concatenate(column) for column in zip(*columns, strict=True))
        inside = in_box(self._box, arrays[0])
        if len(area):
            area = np.minimum(area, np.quantile(area, FOOTPRINT_QUANTILE))
            share, least = area * inside, np.finfo(np.float64).tiny
            if self._importance is not None and len(self._importance.position):
                near = self._importance.nearest(arrays[0], arrays[1])
                share *= _counting(near, upright, share > 0)
                looks = _looks(near, share, self._importance) * lit
                looks /= max(looks.sum(), least)
                share = AREA_SHARE * share / max(share.sum(), least) + (1 - AREA_SHARE) * looks
            share /= max(share.sum(), least)
            area = np.where(inside, share, area / area.sum())
        return _Pixels(*arrays, area, inside)


class _Pixels(NamedTuple):
    """Surface points (P, 3) float32 behind the middles of pixels, with their normals and viewpoints.

    `camera` and `pixel` (P,) int are their numbers, in rows from the top. `share` (P,) is that of the points to draw
    inside the box, or of those outside of it, and `inside` (P,) bool says which lie in it.
    """

    position: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    geometric_normal: np.ndarray
    viewpoint: np.ndarray
    camera: np.ndarray
    pixel: np.ndarray
    share: np.ndarray
    inside: np.ndarray

    def middle(self, index: np.ndarray) -> np.ndarray:
        """The places (N, 2), px, of the middles of pixels `index` (N,) in their images."""
        return np.stack([self.pixel[index] % SIZE, self.pixel[index] // SIZE], axis=1) + 0.5


def _none() -> tuple[np.ndarray, ...]:
    return *(np.empty((0, 3), np.float32),) * 4, np.empty(0, np.int32), np.empty((0, 2))


def _runs(ascending: np.ndarray) -> list[tuple[int, slice]]:
    """The different values of integers (N,) that ascend, each with the slice where it stands."""
    first = np.flatnonzero(np.diff(ascending, prepend=-1))
    return [(int(ascending[a]), slice(a, b)) for a, b in zip(first, [*first[1:], len(ascending)], strict=True)]


def _counting(near: np.ndarray, upright: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Which pixels (P,) bool count, of those that are `near` (P,) the same point of importance.

    Where views look at it `upright` (P,) bool and `inside` the box, a glance along the surface does not count: most
    that is seen by glances alone lies behind what hangs on a wall, in a dark gap into which nobody looks.
    """
    return upright | (np.bincount(near, upright & inside) == 0)[near]


def _looks(near: np.ndarray, area: np.ndarray, importance: ImportanceField) -> np.ndarray:
    """How often people look (P,) at what is behind pixels whose footprints have areas (P,), m^2.

    They are `near` (P,) points of `importance`. What several views see counts once. The points have nearly the same
    share each, so that a footprint that is nearest to the wrong point, like one beside a wall that is nearest to a
    point behind it, gains nothing.
    """
    looks = area * importance.density[near] / np.maximum(importance.views[near], 1)
    around = np.bincount(near, looks, len(importance.position))
    share = np.clip(around, *np.divide(MASS, len(around)))
    return looks * np.divide(share, around, out=np.zeros_like(around), where=around > 0)[near]
