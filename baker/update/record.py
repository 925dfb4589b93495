"""What a bake leaves in the cache about itself, for a bake of the same scene after an edit."""

import json
from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.store import Cache, task_key
from gsgi.baker.settings import Settings
from gsgi.baker.trace.local_light import LocalLight
from gsgi.baker.trace.pilot import Pilot
from gsgi.baker.views.cached_placement import placement_arrays, placement_of
from gsgi.baker.views.placement import Placement

from .parts import Part, as_arrays, from_arrays

if TYPE_CHECKING:
    from gsgi.baker.plan import Plan

PACKAGES = ("drjit", "mitsuba", "numpy", "open3d", "open3d-cpu")  # versions that decide which bits a path gives
PILOT = "deviation", "light"
GATHERED = LocalLight._fields


@dataclass(frozen=True)
class BakeRecord:
    """How a file was baked.

    `code` is the version of the code that traced it; `parts` are those of its scene, which the cache holds once for all
    its bakes; `asked` are the settings that were asked for, and `settings` those that were followed. `samplers` has the
    keys of what the cache has of each sampler: those of the known light, in order, and the last. `references` has those
    of the references, by seed, and `lights` is that of what was learned about lights. `groups` has samplers and lights
    of each light group, by name. `box` (2, 3), m, is that of a sector with its borders, as lists; None: no sector.
    """

    code: str
    parts: list[Part]
    asked: Settings
    settings: Settings
    placement: Placement
    pilot: Pilot
    lost: float | None
    dark: frozenset[str]
    samplers: list[dict[str, list[str]]] = field(default_factory=list)
    references: dict[int, str] = field(default_factory=dict)
    lights: str = ""
    groups: dict[str, tuple[list[dict[str, list[str]]], str]] = field(default_factory=dict)
    box: list[list[float]] | None = None

    @staticmethod
    def of(plan: "Plan", budget: int) -> "BakeRecord":
        """The record of a plan that has been baked with this budget."""
        settings = replace(plan.settings, budget=budget)
        made = code(), plan.parts, plan.asked or settings, settings
        found = plan.placement, plan.pilot, plan.lost, plan.dark
        samplers = [] if settings.operator != "surface" else [each.entries for each in plan.sampler.chain]
        traced = samplers, plan.tracer.references, plan.tracer.lights_key, plan.group_entries
        return BakeRecord(*made, *found, *traced, as_lists(plan.triangles.box))

    def keep(self, cache: Cache, file: bytes) -> None:
        """Keep the record in a cache, for a file with these bytes.

        A bake without references keeps those that an earlier one has left of the same file.
        """
        pilot, references = self.pilot, self.references
        if not references and (before := BakeRecord.find(cache, file)) and before.code == self.code:
            references = before.references
        rest = {
            "code": self.code,
            "parts": keep_parts(cache, self.parts),
            "asked": asdict(self.asked),
            "settings": asdict(self.settings),
            "mean": pilot.mean,
            "lost_by": list(pilot.lost.items()),
            "lost": self.lost,
            "dark": sorted(self.dark),
            "samplers": self.samplers,
            "references": list(references.items()),
            "lights": self.lights,
            "groups": list(self.groups.items()),
            "box": self.box,
        }
        arrays = {f"placement.{name}": value for name, value in placement_arrays(self.placement).items()}
        arrays |= {f"pilot.{name}": getattr(pilot, name) for name in PILOT}
        arrays |= {f"gathered.{name}": getattr(pilot.gathered, name) for name in GATHERED}
        arrays["record"] = np.frombuffer(json.dumps(rest).encode(), np.uint8)
        cache.put(_key(file), arrays)

    @staticmethod
    def find(cache: Cache, file: bytes) -> "BakeRecord | None":
        """The record that a cache has of a file with these bytes; None if it has none."""
        arrays = cache.get(_key(file))
        if arrays is None:
            return None

        def under(prefix: str) -> dict[str, np.ndarray]:
            return {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}

        rest = json.loads(arrays["record"].tobytes())
        described = find_parts(cache, rest["parts"])
        if described is None:
            return None
        gathered = LocalLight(**under("gathered."))
        return BakeRecord(
            rest["code"],
            described,
            settings_of(rest["asked"]),
            settings_of(rest["settings"]),
            placement_of(under("placement.")),
            Pilot(rest["mean"], dict(rest["lost_by"]), gathered=gathered, **under("pilot.")),
            rest["lost"],
            frozenset(rest["dark"]),
            rest["samplers"],
            dict(rest["references"]),
            rest["lights"],
            {name: (samplers, lights) for name, (samplers, lights) in rest["groups"]},
            rest["box"],
        )

    def of_group(self, name: str) -> "BakeRecord":
        """The record as if the light of one light group were all."""
        samplers, lights = self.groups[name]
        return replace(self, samplers=samplers, lights=lights, references={}, groups={})

    @property
    def entries(self) -> list[str]:
        """The keys of all that an update needs from the cache, but for references, which can be traced again."""
        samplers = [*self.samplers, *(sampler for chain, _ in self.groups.values() for sampler in chain)]
        return [key for sampler in samplers for keys in sampler.values() for key in keys]


def as_lists(box: np.ndarray | None) -> list[list[float]] | None:
    """A box (2, 3) as JSON holds it."""
    return None if box is None else np.asarray(box).tolist()


def keep_parts(cache: Cache, parts: list[Part]) -> str:
    """Keep the parts of a scene in a cache; return their key."""
    text = np.frombuffer(json.dumps(as_arrays(parts)).encode(), np.uint8)
    key = task_key("parts", text=text)
    if cache.get(key) is None:  # asked for, so that the cache does not remove it before the records that need it
        cache.put(key, {"text": text})
    return key


def find_parts(cache: Cache, key: str) -> list[Part] | None:
    """The parts that a cache has under a key; None if it has none."""
    arrays = cache.get(key)
    return None if arrays is None else from_arrays(json.loads(arrays["text"].tobytes()))


def other_settings(before: Settings, after: Settings) -> list[str]:
    """The settings that differ, each as "name before, now after"."""
    pairs = ((each.name, getattr(before, each.name), getattr(after, each.name)) for each in fields(Settings))
    return [f"{name.replace('_', '-')} {_word(a)}, now {_word(b)}" for name, a, b in pairs if a != b]


def settings_of(values: dict) -> Settings:
    """The settings that `asdict` and JSON have taken apart."""
    return Settings(**values | {"ignore": tuple(values["ignore"])})


def code() -> str:
    """Version of the code that traces samples and references, with that of the packages it calls."""
    return code_version("gsgi.baker.plan", PACKAGES)


def _word(value) -> str:
    return "by default" if value is None else " ".join(value) or "none" if isinstance(value, tuple) else str(value)


def _key(file: bytes) -> str:
    return task_key("baked", file=np.frombuffer(file, np.uint8))
