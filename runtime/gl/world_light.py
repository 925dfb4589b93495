"""Indirect light of a world: the sectors in memory, read together at the surfaces of a frame."""

import moderngl
import numpy as np

from gsgi.runtime.gaussians import Effects
from gsgi.runtime.lookup_tables import seen_from, sh_counts
from gsgi.runtime.world.boxes import FAR, classes
from gsgi.runtime.world.world import World

from .cull import in_view
from .host_textures import OURS, Encoding
from .lookup_textures import LookupTextures
from .permutations import Reading
from .surface_light import Box, Part, SurfaceLight
from .view import View


class WorldLight(SurfaceLight):
    """The sectors of a world on the GPU, as `SurfaceLight` has one bake. They follow what is in memory.

    `origin` (3,), m, is the world's point at which the view has its origin.
    """

    def __init__(
        self, ctx: moderngl.Context, world: World, origin: np.ndarray, splat_scale: int, encoding: Encoding = OURS,
        box: Box | None = None, relief: bool = False,
    ):  # fmt: skip
        self._world, self._origin = world, origin
        world.drawn = True
        self._classes = classes(world.manifest.boxes, world.manifest.margin)
        self._parts: dict[int, Part] = {}
        self._balls: dict[int, tuple[float, ...]] = {}  # around what each part lights
        relief = relief and Effects.NORMAL_MAP in world.effects
        reading = Reading(splat_scale, encoding, box is not None, relief, sectors=True)
        self._make_passes(ctx, reading, box, world.manifest.margin)
        self._table, self._rows = ctx.texture((2, 1), 4, dtype="f4"), np.zeros((0, 2, 4), np.float32)

    def release(self) -> None:
        """Free the GPU memory."""
        for part in self._parts.values():
            part.textures.release()
        self._parts.clear()
        self._table.release()
        self._release_passes()

    def _groups(self, view: View) -> list[tuple[int, list[Part]]]:
        """The sectors in view by their classes: each point has the light of at most one sector of a class."""
        self._follow()
        self._tell()
        numbers, balls = list(self._balls), np.array(list(self._balls.values()), np.float32).reshape(-1, 4).T
        groups: dict[int, list[Part]] = {}
        for number in (numbers[i] for i in in_view(balls[:3], balls[3], view.pinhole, view.parallel)):
            if self._world.resident[number].weight > 0:
                groups.setdefault(int(self._classes[number]), []).append(self._parts[number])
        return sorted(groups.items()) or [(0, [])]

    def _tables(self) -> list[moderngl.Texture]:
        return [self._table]

    def _follow(self) -> None:
        """Upload the sectors that have come into memory, and free those that have gone."""
        resident = self._world.resident
        for number in [number for number in self._parts if number not in resident]:
            self._parts.pop(number).textures.release()
            del self._balls[number]
        for number, sector in resident.items():
            if number not in self._parts:
                box = self._world.windows[number]
                box = np.where(np.abs(box) < FAR, box - self._origin, box).astype(np.float32)
                textures = LookupTextures(self.ctx, seen_from(sector.tables, self._origin))
                self._parts[number] = Part(textures, sh_counts(sector.bake), tuple(box))
                self._balls[number] = _ball(sector.reached - self._origin, box, self._world.manifest.margin)

    def _tell(self) -> None:
        """Upload the windows of all sectors with their weights and classes, if something has changed."""
        rows = np.zeros((max(len(self._parts), 1), 2, 4), np.float32)
        for row, (number, part) in zip(rows, self._parts.items(), strict=False):
            row[:, :3] = part.window
            row[:, 3] = self._world.resident[number].weight, self._classes[number]
        if not np.array_equal(rows, self._rows):
            if len(rows) != self._table.height:
                self._table.release()
                self._table = self.ctx.texture((2, len(rows)), 4, dtype="f4")
            self._table.write(rows)
            self._rows = rows
        self._points.set(sector_count=len(self._parts))


def _ball(reached: np.ndarray, box: np.ndarray, margin: float) -> tuple[float, ...]:
    """Centre and radius (4,) of a ball around what a sector lights of a box (2, 3); the radius is NaN of nothing."""
    low, high = np.maximum(reached[0], box[0] - margin), np.minimum(reached[1], box[1] + margin)
    radius = np.linalg.norm(high - low) / 2 if (low <= high).all() else np.nan
    return *((low + high) / 2), radius
