"""The light of a world at run time: the sectors around an eye, loaded and freed within a budget of memory."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from gsgi.runtime.errors import FormatError
from gsgi.runtime.gaussians import Bake, Effects, LightGroup, SurfaceBlend
from gsgi.runtime.lookup_tables import Tables, lookup_tables
from gsgi.runtime.sampling import Sampler

from .boxes import fading, windows
from .loader import Loader, attempt
from .manifest import read_manifest

BUDGET, FADE = 256 << 20, 1.5  # bytes; s

# A sector's weight is the square of a clock that runs from 0 to 1, near enough to the inverse of the sRGB curve that
# all steps look alike. One of STEP_MOST moves a pixel that this light alone shows white by less than 4/255.
POWER, STEP_MOST = 2.4, 1 / 72

PREPARED = "sampler", "tables", "reached"  # of a sector in memory, which other weights do not change

KEPT = 0.9  # factor on the distance of a sector that is there, so that none comes and goes where two are as far


@dataclass(frozen=True)
class Resident:
    """A sector in memory: its `bake`, and the `clock` that its weight follows."""

    bake: Bake
    clock: float

    @property
    def weight(self) -> float:
        """Factor on its light."""
        return self.clock**POWER

    @cached_property
    def sampler(self) -> Sampler:
        """Reads its light at points."""
        return Sampler(self.bake)

    @cached_property
    def tables(self) -> Tables:
        """By which shaders read its light."""
        return lookup_tables(self.bake)

    @cached_property
    def reached(self) -> np.ndarray:
        """The corners (2, 3) float64 of a box around all that its Gaussians light, m; of nothing they are infinite."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for level in (self.bake.gaussians, self.bake.coarse):
            reach = self.bake.blend.radius * level.scale.max(axis=1, initial=0)[:, None]
            low = np.minimum(low, (level.position - reach).min(axis=0, initial=np.inf))
            high = np.maximum(high, (level.position + reach).max(axis=0, initial=-np.inf))
        return np.stack([low, high])


class World:
    """A world's light, of which those sectors are in memory that are nearest to an eye.

        world = gsgi.World("level.gsgi.json")
        light = gsgi.IndirectLight(ctx, world)
        ...
        world.update(eye, seconds)  # each frame
        light.draw(depth, normal, view_from_world, clip_from_view)

    At most `budget` bytes of Gaussians are in memory, the nearest first; a thread reads the files. Light of a sector
    comes and goes within `fade` seconds, and there is none where no sector is in memory. All methods are to be called
    from one thread. `changing` tells whether the last update() has left something to read or to fade. `drawn`, which
    `IndirectLight` sets, lets the thread prepare sectors for shaders too. Raises FileError and FormatError for the
    manifest, and ValueError for a budget below the largest sector.
    """

    def __init__(self, path: str | Path, budget: int = BUDGET, fade: float = FADE):
        self.manifest = read_manifest(path)
        self.budget, self._fade = budget, fade
        self._boxes, self._memory = self.manifest.boxes, np.array([s.memory for s in self.manifest.sectors])
        near = [sector.neighbours for sector in self.manifest.sectors]
        self.windows = fading(self._boxes, near, self.manifest.margin)
        self._resident: dict[int, Resident] = {}
        self._blend: SurfaceBlend | None = None
        self._loader: Loader | None = None
        self._broken: list[int] = []
        self.changing = self.drawn = False
        if not self._memory.max() <= budget:
            largest = self.manifest.sectors[int(self._memory.argmax())]
            raise ValueError(f"budget: expected at least {largest.memory} bytes for {largest.file}, got {budget}")
        if not fade > 0:
            raise ValueError(f"fade: expected more than 0 s, got {fade}")

    @property
    def scene(self) -> int:
        """The fingerprint of the scene."""
        return self.manifest.scene

    @property
    def effects(self) -> Effects:
        """The effects in the light."""
        return self.manifest.effects

    @property
    def blend(self) -> SurfaceBlend:
        """How the Gaussians become light, in all sectors; the default until one is in memory."""
        return self._blend or SurfaceBlend()

    @property
    def groups(self) -> tuple[LightGroup, ...]:
        """None: the lights of a world are not baked apart."""
        return ()

    @property
    def resident(self) -> Mapping[int, Resident]:
        """The sectors in memory, by their numbers in the manifest."""
        return MappingProxyType(self._resident)

    @property
    def memory(self) -> int:
        """Bytes of the Gaussians in memory."""
        return int(self._memory[list(self._resident)].sum())

    def update(self, eye: np.ndarray, seconds: float) -> None:
        """Let `seconds` pass with an eye at (3,), m: sectors come into memory, fade, and go.

        Raises FileError or FormatError for a sector whose file is not the one of the manifest, once: later calls do
        without that sector. Raises ValueError for an eye that is no place, and for time that does not pass.
        """
        if not seconds >= 0:
            raise ValueError(f"seconds: expected a number from 0 on, got {seconds}")
        eye = _checked(eye)
        if self._loader is None:
            self._loader = Loader(self._read)
        if (loaded := self._loader.finished()) is not None:
            self._add(*loaded)
        wanted = self._wanted(eye)
        step = min(seconds / self._fade, STEP_MOST)
        self.changing = False
        for number, sector in list(self._resident.items()):
            clock = min(max(sector.clock + (step if number in wanted else -step), 0.0), 1.0)
            if clock != sector.clock:
                self._resident[number], self.changing = _aged(sector, clock), True
            if not clock and number not in wanted:
                del self._resident[number]
        if not self._loader.busy:
            room = self.budget - self.memory
            missing = (number for number in wanted if number not in self._resident)
            if (first := next(missing, None)) is not None and self._memory[first] <= room:
                self._loader.load(first)
        self.changing |= self._loader.busy

    def settle(self, eye: np.ndarray | None = None) -> None:
        """Load at once what is wanted around an eye at (3,), m, or what fits in any place, at its full weight.

        For tools that need no frame rate. Raises what update() does for files and the eye.
        """
        wanted = self._wanted(self._boxes.mean(axis=(0, 1)) if eye is None else _checked(eye))
        for number in set(self._resident) - set(wanted):
            del self._resident[number]
        for number in wanted:
            if number not in self._resident:
                self._add(number, attempt(self._read, number))
            self._resident[number] = _aged(self._resident[number], 1.0)

    def sample(self, positions: np.ndarray, normals: np.ndarray, free: bool = False) -> np.ndarray:
        """B (N, 3) float32 at points (N, 3), m, with normals (N, 3), as `gsgi.sample` gives it for a bake.

        It is read from the sectors in memory; the first time that a sector is read, this prepares it.
        """
        positions, normals = np.asarray(positions), np.asarray(normals)
        if positions.ndim != 2 or positions.shape[1] != 3 or normals.shape != positions.shape:
            raise ValueError(f"positions {positions.shape}, normals {normals.shape}: both must be (N, 3)")
        light, total = np.zeros((len(positions), 3), np.float32), np.zeros(len(positions), np.float32)
        for number, sector in self._resident.items():
            window = np.float32(sector.weight) * windows(self.windows[number], self.manifest.margin, positions)
            here = np.flatnonzero(window > 0)
            light[here] += window[here, None] * sector.sampler.sample(positions[here], normals[here], free=free)
            total += np.nan_to_num(window)
        # Around a box that is left out windows add up to more than 1.
        return light / np.maximum(total, 1)[:, None]

    def weight(self, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Weight (N,) float32 of the fine levels in memory at points (N, 3), m, with normals (N, 3)."""
        weight = np.zeros(len(positions), np.float32)
        for number, sector in self._resident.items():
            here = np.flatnonzero(windows(self.windows[number], self.manifest.margin, positions) > 0)
            weight[here] += sector.sampler.weight(positions[here], normals[here])
        return weight

    def close(self) -> None:
        """Free all sectors and end the thread. Calling it twice is harmless."""
        self._resident.clear()
        if self._loader:
            self._loader.close()
            self._loader = None

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _wanted(self, eye: np.ndarray) -> list[int]:
        """The sectors that are to be in memory, the nearest first: as many as the budget holds."""
        outside = np.maximum(np.maximum(self._boxes[:, 0] - eye, eye - self._boxes[:, 1]), 0)
        middle = np.linalg.norm(self._boxes.mean(axis=1) - eye, axis=1)
        # Several boxes are at distance 0 where the eye is on a border: then their middles decide.
        distance = np.linalg.norm(outside, axis=1) + 1e-3 * middle
        distance[list(self._resident)] *= KEPT
        order = np.argsort(distance, kind="stable")
        order = order[~np.isin(order, self._broken)]
        fit = np.cumsum(self._memory[order]) <= self.budget
        return order[fit].tolist()

    def _read(self, number: int) -> Resident:
        """A sector as it is in its file, ready to be drawn."""
        sector = Resident(self.manifest.read(number), 0.0)
        if self.drawn:
            _ = sector.tables, sector.reached
        return sector

    def _add(self, number: int, found: Resident | Exception) -> None:
        if isinstance(found, Resident) and self._blend not in (None, found.bake.blend):
            path = self.manifest.path.parent / self.manifest.sectors[number].file
            found = FormatError(f"{path}: expected the blend of other sectors, {self._blend}, got {found.bake.blend}")
        if isinstance(found, Exception):
            self._broken.append(number)
            raise found
        self._blend = found.bake.blend
        self._resident[number] = found


def _checked(eye: np.ndarray) -> np.ndarray:
    """An eye as (3,) float64, m. Raises ValueError for one that is no place."""
    try:
        place = np.asarray(eye, np.float64)
    except (TypeError, ValueError):
        place = np.full(1, np.nan)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError(f"eye: expected three finite numbers, m, got {eye}")
    return place


def _aged(sector: Resident, clock: float) -> Resident:
    """The sector at another time, with what has been prepared of it."""
    aged = replace(sector, clock=clock)
    vars(aged).update({name: made for name, made in vars(sector).items() if name in PREPARED})
    return aged
