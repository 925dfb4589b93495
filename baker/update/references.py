"""A tracer whose references are those of an earlier bake where they still hold."""

from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.records import from_arrays
from gsgi.baker.cache.store import Cache
from gsgi.baker.trace import reference
from gsgi.baker.trace.cached_tracer import CachedTracer, reference_task
from gsgi.baker.trace.irradiance_cache import KnownLight
from gsgi.baker.trace.local_light import local_light
from gsgi.baker.trace.reference import Reference
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.baker.trace.visible import Surface
from gsgi.runtime.camera import Camera
from gsgi.runtime.light_groups import lit_by
from gsgi.runtime.scene import Scene

from .record import BakeRecord
from .tally import AGAIN, GONE, NEW, SAME, SHIFTED, Tally
from .thin_share import CHANGED, SHARE, ThinShare

if TYPE_CHECKING:
    from gsgi.baker.trace.learned_lights import LearnedLights

WHERE = "position", "shading_normal", "geometric_normal"
EDGE = round(SHARE**0.5)  # px: one pixel of a square of so many is traced again


class UpdatedTracer(CachedTracer):
    """Traces a scene after an edit. What a reference shows besides B is exact; B is kept as that of samples is."""

    def __init__(self, scene: Scene, cache: Cache, record: BakeRecord, tally: Tally, whole: CachedTracer | None = None):
        """`record` is that of the earlier bake; `whole` traces the same scene, or that with more lights."""
        super().__init__(scene, cache, whole)
        self._record, self._tally = record, tally
        self._before, self._lights, self.samplers = record.references, record.lights, record.samplers

    def lit_by(self, group: str) -> "UpdatedTracer":
        """A tracer of the light of one light group, which the earlier bake had too."""
        return UpdatedTracer(lit_by(self.scene, group), self.cache, self._record.of_group(group), Tally(), self)

    @property
    def lights_key(self) -> str:
        """The key of what the earlier bake has learned about lights, if the cache has it."""
        return self._lights if self.cache.holds(self._lights) else super().lights_key

    def learned(self, tracer: Tracer) -> "LearnedLights | None":
        """The same as before, if the lights are: other choices of lights would change all paths."""
        learned = super().learned(tracer)
        if learned is None or learned.suits(tracer):
            return learned
        self._lights = super().lights_key
        return super().learned(tracer)

    def reference(
        self, camera: Camera, size: int, samples: int, seed: int, advance,
        known: KnownLight | None = None,
    ) -> Reference:  # fmt: skip
        """The reference of `CachedTracer.reference`, traced as a whole where the cache has no earlier one."""
        found = self.cache.get(self._before[seed]) if seed in self._before else None
        if found is None:
            return super().reference(camera, size, samples, seed, advance, known)
        before, key = from_arrays(Reference, found), self._before[seed]
        task = reference_task(camera, size, samples, seed, known)
        self.references[seed] = key = self.key("reference", __name__, before=key, **task)
        sampling = Sampling(-(-samples // 2))
        truth, _ = self.once(key, Reference, lambda: self._updated(before, camera, sampling, seed, known))
        advance(2 * size**2)
        return truth

    def _updated(self, before: Reference, camera: Camera, sampling: Sampling, seed: int, known) -> Reference:
        size = before.valid.shape[0]
        now = self.tracer.surface(camera, size, size)
        fate = _fate(before.surface, now)
        numbers = reference.path_numbers(size, size, sampling, seed)
        halves = [before.indirect_a.copy(), before.indirect_b.copy()]

        def trace(which: np.ndarray) -> tuple[np.ndarray, ...]:
            where = (getattr(now, name)[which] for name in WHERE)
            lights = self.tracer.halves(*where, sampling, seed, None, known, numbers[which])
            return *(light.mean for light in lights), (lights[0].samples > 0) & (lights[1].samples > 0)

        y, x = np.mgrid[:size, :size]
        thin = (fate == SAME) & before.valid & (x % EDGE == EDGE // 2) & (y % EDGE == EDGE // 2)
        *found, _ = trace(thin)
        kept = fate == SAME
        where = now.position[kept], now.shading_normal[kept]
        level = local_light(*where, *(half[kept] for half in halves)).level
        changes = (new - half[thin] for new, half in zip(found, halves, strict=True))
        share = ThinShare(now.position[thin], now.shading_normal[thin], *changes, level[thin[kept]])
        verdict = share.judge(*where)
        fate[kept] = np.where(verdict.change > CHANGED, AGAIN, np.where(verdict.same, SAME, SHIFTED))
        again = (fate == AGAIN) | (fate == NEW)
        *found, both = trace(again)
        for half, shift, light in zip(halves, (verdict.shift_a, verdict.shift_b), found, strict=True):
            half[kept] = np.maximum(half[kept] + level[:, None] * shift, 0)
            half[again] = light
            half[~now.diffuse] = 0
        valid = before.valid & now.diffuse
        valid[again] = both
        self._tally.add("references", f"{seed}", fate[now.diffuse])
        return Reference(now, reference.primary(self.tracer, now), *halves, valid)


def _fate(before: Surface, now: Surface) -> np.ndarray:
    """What becomes of each pixel (H, W) so far: SAME, NEW or GONE."""
    same = np.all([getattr(before, name) == getattr(now, name) for name in WHERE], axis=(0, 3))
    same &= before.diffuse & now.diffuse
    return np.where(now.diffuse, np.where(same, SAME, NEW), GONE).astype(np.uint8)
