"""Indirect light of a world: the sectors in memory, read together at the surfaces of a frame."""

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Effects
from gsgi.runtime.rebase import local_bake
from gsgi.runtime.world.boxes import FAR, classes
from gsgi.runtime.world.world import World

from .cull import in_view
from .host_textures import OURS, Encoding
from .permutations import Reading
from .surface_level import SurfacePart, Window
from .surface_splat import Box, Group, SurfaceSplats
from .view import View


class WorldSplats(SurfaceSplats):
    """The sectors of a world on the GPU, as `SurfaceSplats` has those of one bake. They follow what is in memory.

    `origin` (3,), m, is the world's point at which the view has its origin.
    """

    def __init__(
        self, ctx: moderngl.Context, world: World, origin: np.ndarray, splat_scale: int, encoding: Encoding = OURS,
        box: Box | None = None, relief: bool = False,
    ):  # fmt: skip
        self._world, self._origin = world, origin
        self._classes = classes(world.manifest.boxes, world.manifest.margin)
        self._parts: dict[int, SurfacePart] = {}
        self._windows: dict[int, Window] = {}  # of the parts, `world.windows` from the origin
        self._balls: dict[int, tuple[float, ...]] = {}  # around what each part lights
        relief = relief and Effects.NORMAL_MAP in world.effects
        self._make_passes(ctx, Reading(splat_scale, encoding, True, box is not None, relief, sectors=True), box)
        self._points.set(sector_margin=world.manifest.margin)
        self._table, self._rows = ctx.texture((2, 1), 4, dtype="f4"), np.zeros((0, 2, 4), np.float32)

    def release(self) -> None:
        """Free the GPU memory."""
        for part in (*self._parts.values(), self._table):
            part.release()
        self._parts.clear()
        self._release_passes()

    def _groups(self, view: View) -> list[tuple[int, Group]]:
        """The sectors in view by their classes: each point has the light of at most one sector of a class."""
        self._follow()
        self._tell()
        numbers, balls = list(self._balls), np.array(list(self._balls.values()), np.float32).reshape(-1, 4).T
        groups: dict[int, Group] = {}
        for number in (numbers[i] for i in in_view(balls[:3], balls[3], view.pinhole, view.parallel)):
            if self._world.resident[number].weight > 0:
                groups.setdefault(int(self._classes[number]), []).append((self._parts[number], self._windows[number]))
        return sorted(groups.items()) or [(0, [])]

    def _tables(self) -> list[moderngl.Texture]:
        return [self._table]

    def _follow(self) -> None:
        """Upload the sectors that have come into memory, and free those that have gone."""
        resident = self._world.resident
        for number in [number for number in self._parts if number not in resident]:
            self._parts.pop(number).release()
            del self._windows[number], self._balls[number]
        for number, sector in resident.items():
            if number not in self._parts:
                bake, box = local_bake(sector.bake, self._origin), self._world.windows[number]
                part = SurfacePart(self.ctx, self._programs, bake, self._relief, sector=True)
                box = np.where(np.abs(box) < FAR, box - self._origin, box).astype(np.float32)
                ball = _ball(part, box, self._world.manifest.margin)
                self._parts[number], self._windows[number], self._balls[number] = part, Window(*box), ball
                self._set_floor(bake.blend.floor)
                self._programs.set(sector_margin=self._world.manifest.margin)

    def _tell(self) -> None:
        """Upload the windows of all sectors with their weights and classes, if something has changed."""
        rows = np.zeros((max(len(self._windows), 1), 2, 4), np.float32)
        for row, (number, window) in zip(rows, self._windows.items(), strict=False):
            row[0], row[1] = (*window.low, self._world.resident[number].weight), (*window.high, self._classes[number])
        if not np.array_equal(rows, self._rows):
            if len(rows) != self._table.height:
                self._table.release()
                self._table = self.ctx.texture((2, len(rows)), 4, dtype="f4")
            self._table.write(rows)
            self._rows = rows
        self._points.set(sector_count=len(self._windows))


def _ball(part: SurfacePart, box: np.ndarray, margin: float) -> tuple[float, ...]:
    """Centre and radius (4,) of a ball around all that a sector lights; the radius is NaN of nothing."""
    low = np.min([(level.position - level.radius).min(axis=1, initial=np.inf) for level in part.levels], axis=0)
    high = np.max([(level.position + level.radius).max(axis=1, initial=-np.inf) for level in part.levels], axis=0)
    low, high = np.maximum(low, box[0] - margin), np.minimum(high, box[1] + margin)
    radius = np.linalg.norm(high - low) / 2 if (low <= high).all() else np.nan
    return *((low + high) / 2), radius
