"""Light groups: what each costs in a bake and in its file, and how far its light alone is from path tracing."""

from dataclasses import replace

import numpy as np
from repository import SCENES

import gsgi
from gsgi.baker import job
from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan, make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.report import BakeReport
from gsgi.baker.settings import Settings
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.light_groups import lit_by
from gsgi.runtime.lighting import Lighting, light
from gsgi.runtime.scene import Scene

POINTS, PATHS = 4096, 1024
GROUPS = {"lamp": ("ceiling spot", "lamp"), "day": ("environment",)}
DIM = 1e-3  # factor on the sky in one of the rows


def light_groups() -> list[dict]:
    """Seconds of a group relative to all light, bytes per Gaussian, error of its light alone, and of a bake of that."""
    return [
        row
        for name in ("cornell", "cornell_emissive")
        for scale in (1.0, DIM)
        for row in rows(f"{name}, sky x {scale:g}", read(name, scale))
    ]


def read(name: str, scale: float) -> Scene:
    """A Cornell box with its lamp and a blue sky, in two groups."""
    scene = gsgi.read_scene(SCENES / f"{name}.glb")
    groups = {"lamp": tuple(one for one in GROUPS["lamp"] if one in names(scene)), "day": GROUPS["day"]}
    return light(scene, Lighting(env=(0.3, 0.5, 1.0), env_scale=scale, groups=groups))


def names(scene: Scene) -> set[str]:
    """Of lights and of materials."""
    return {one.name for one in (*scene.lights, *scene.materials)}


def rows(title: str, scene: Scene) -> list[dict]:
    """A row for each group."""
    plan, report, whole = baked(scene)
    seen = plan.placement.importance
    where = seen.position[:POINTS], seen.normal[:POINTS]
    seconds, count = report.seconds, len(whole.gaussians) + len(whole.coarse)
    plain = sum(seconds[stage] for stage in ("known light", "irradiance", "fit"))
    result = []
    for group in whole.groups:
        alone = lit_by(scene, group.name)
        truth = Tracer(alone).halves(*where, where[1], Sampling(PATHS), seed=9)
        weights = {other.name: float(other is group) for other in whole.groups}
        own = baked(replace(alone, groups={}))[2]
        size = len(codec.encode(whole)) - len(codec.encode(replace(whole, groups=without(whole, group.name))))
        result.append({
            "scene": title, "group": group.name, "gaussians": count,
            "time": round(seconds[f"light group {group.name}"] / plain, 2),
            "bytes_per_gaussian": round(size / count, 2),
            "error": round(error(gsgi.sample(whole, *where, weights), truth), 4),
            "error_own_bake": round(error(gsgi.sample(own, *where), truth), 4),
        })  # fmt: skip
    return result


def without(bake: Bake, name: str) -> tuple:
    """The groups of a bake but one."""
    return tuple(group for group in bake.groups if group.name != name)


def baked(scene: Scene) -> tuple[Plan, BakeReport, Bake]:
    """A bake of medium quality without a cache, and the plan for it."""
    progress = Progress()
    plan = make_plan(scene, Settings(), progress, Cache())
    report = job.run(plan, progress, lambda data, count: None, evaluate=False)
    return plan, report, codec.decode(report.data)


def error(found: np.ndarray, halves) -> float:
    """Relative RMS error, free of the noise of both halves."""
    a, b = (half.mean.astype(np.float64) for half in halves)
    return float(np.sqrt(max(((found - a) * (found - b)).mean(), 0) / (a * b).mean()))
