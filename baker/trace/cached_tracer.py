"""The light of one scene as cached tasks: a task whose result is in the cache is not traced again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.digest import scene_digest
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.cache.store import Cache, task_key
from gsgi.runtime.camera import Camera
from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.light_groups import lit_by
from gsgi.runtime.scene import Scene

from . import reference
from .device import device
from .irradiance_cache import IrradianceCache, KnownLight
from .tracer import Light, LightByBounces, Sampling, Tracer

if TYPE_CHECKING:
    from .learned_lights import LearnedLights

PACKAGES = ("mitsuba", "drjit", "numpy")


@dataclass(frozen=True)
class TracedView:
    """A traced view.

    indirect (H, W, 3) float32 is B as traced, 0 where not valid. normal (H, W, 3) and depth (H, W), along the camera's
    -Z in m, describe the surface. valid (H, W) marks the pixels that show a diffuse surface (see Surface) and have a B
    from at least one path. invalid is the number of paths that gave no finite number.
    """

    indirect: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    valid: np.ndarray
    invalid: int


def reference_task(camera: Camera, size: int, samples: int, seed: int, known: KnownLight | None) -> dict:
    """What decides a reference, beside the scene, for its key."""
    return {"camera": camera, "size": size, "samples": samples, "seed": seed, "known": known and known.key}


class CachedTracer:
    """Traces the light of `scene`, each task once. Mitsuba starts at the first task that is not in `cache`."""

    def __init__(self, scene: Scene, cache: Cache, whole: "CachedTracer | None" = None):
        """`whole` traces the same scene, or that with more lights; both share the surfaces."""
        self.scene, self.cache, self._whole = scene, cache, whole
        self.references: dict[int, str] = {}  # keys of what the cache has of each reference, by its seed

    @cached_property
    def fingerprint(self) -> int:
        """The fingerprint of the scene, which all sectors of a world share."""
        return self._whole.fingerprint if self._whole else fingerprint(self.scene)

    def lit_by(self, group: str) -> "CachedTracer":
        """A tracer of the light of one of the scene's light groups."""
        return CachedTracer(lit_by(self.scene, group), self.cache, self)

    def at_points(
        self, position, normal, sampling: Sampling, seed: int, advance=None, known: IrradianceCache | None = None,
        geometric_normal=None,
    ) -> Light:  # fmt: skip
        """B at surface points: position (N, 3) float32 m, normal (N, 3) float32 unit; paths end in `known` light.

        `geometric_normal` (N, 3) is that of the triangles, by default the normal.
        """
        points = position, normal, normal if geometric_normal is None else geometric_normal
        key = self.key("points", __name__, points=points, sampling=sampling, seed=seed, known=known)
        light, found = self.once(key, Light, lambda: self.tracer.indirect(*points, sampling, seed, advance, known))
        if found and advance:
            advance(len(position))
        return light

    def by_bounces(self, position, normal, sampling: Sampling, seed: int, most: int) -> LightByBounces:
        """The light of `at_points`, and what of it comes by at most 0, 1, ... `most` bounces."""
        task = (position, normal, normal), sampling, seed, most
        key = self.key("bounces", __name__, task=task)
        return self.once(key, LightByBounces, lambda: self.tracer.by_bounces(*task[0], *task[1:]))[0]

    def views(
        self,
        cameras: Sequence[Camera],
        size: int,
        sampling: Sampling,
        seed: int,
        advance: Callable[..., None],
        say: Callable[[str], None],
    ) -> list[TracedView]:
        """A square view of `size` px for each camera, the n-th from `seed` + n. Tells `say` how many were cached."""
        views, known = [], 0
        for i, camera in enumerate(cameras):
            task = camera, size, sampling, seed + i
            key = self.key("view", __name__, task=task)
            view, found = self.once(key, TracedView, lambda task=task: self._view(*task, advance))
            advance(size**2 if found else 0, f"view {i + 1}/{len(cameras)}")
            views.append(view)
            known += found
        if known:
            say(f"{known} of {len(cameras)} views from the cache")
        return views

    def reference(
        self, camera: Camera, size: int, samples: int, seed: int, advance,
        known: KnownLight | None = None,
    ) -> reference.Reference:  # fmt: skip
        """A square reference of `size` px, in two halves, whose paths end in `known` light."""
        key = self.key("reference", __name__, **reference_task(camera, size, samples, seed, known))
        self.references[seed] = key
        truth, found = self.once(
            key,
            reference.Reference,
            lambda: reference.trace(self.tracer, camera, size, size, samples, seed, advance, known),
        )
        if found:
            advance(2 * size**2, "from the cache")
        return truth

    def key(self, stage: str, module: str, **inputs) -> str:
        """The cache key of a task on this scene that the code of `module` computes from `inputs`, on our device."""
        if device() != "cpu":
            inputs["device"] = device()
        return task_key(stage, code=code_version(module, PACKAGES), scene=self.scene_digest, **inputs)

    def once(self, key: str, kind: type, compute: Callable[[], object]) -> tuple[object, bool]:
        """The record of type `kind` under `key`, computed and cached if missing; and whether it was in the cache."""
        if found := self.cache.get(key):
            return from_arrays(kind, found), True
        record = compute()
        self.cache.put(key, to_arrays(record))
        return record, False

    def _view(self, camera: Camera, size: int, sampling: Sampling, seed: int, advance) -> TracedView:
        surface = self.tracer.surface(camera, size, size)
        light = self.tracer.indirect(*surface.points(), sampling, seed, advance)
        advance(float((~surface.diffuse).sum()))
        valid = surface.image(light.samples > 0)
        return TracedView(surface.image(light.mean), surface.normal, surface.depth, valid, light.invalid)

    @cached_property
    def scene_digest(self) -> str:
        """The digest of the scene, for the keys of tasks that depend on it."""
        same = self._whole and self._whole.scene is self.scene
        return self._whole.scene_digest if same else scene_digest(self.scene)

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer, made when it is first needed."""
        tracer = self._whole.tracer.lit_by(self.scene) if self._whole else Tracer(self.scene)
        tracer.recall = self.learned
        return tracer

    def start(self) -> None:
        """Make the tracer, before it is needed."""
        _ = self.tracer

    @property
    def lights_key(self) -> str:
        """The key of what is learned about the scene's lights, which the cache has if there is something to choose."""
        return self.key("lights", "gsgi.baker.trace.learned_lights")

    def learned(self, tracer: Tracer) -> "LearnedLights | None":
        """What a tracer of the scene learns about its lights; None if there is nothing to choose."""
        from .learned_lights import LearnedLights, learn

        if found := self.cache.get(self.lights_key):
            return from_arrays(LearnedLights, found)
        learned = learn(tracer)
        if learned:
            self.cache.put(self.lights_key, to_arrays(learned))
        return learned
