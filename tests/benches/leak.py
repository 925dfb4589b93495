"""Light that leaks through a thin wall into a dark room."""

import numpy as np
from repository import SCENES

from gsgi.baker.bake import bake
from gsgi.baker.cache.store import Cache
from gsgi.baker.cli.console import Console
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.trace.tracer import Sampling
from gsgi.runtime.file import codec
from gsgi.runtime.gltf.reader import read_gltf

DARK = 1e-6  # of the mean B; a point with less path-traced B counts as dark
FAINT = 0.005  # of the bright room's mean B


def leak() -> list[dict]:
    """B of the default bake of `two_rooms` at points of the dark room, as a share of the bright room's mean B.

    `above_0.5_%` is the share of those points with more than half a per cent of it.
    """
    plan = make_plan(read_gltf(SCENES / "two_rooms.glb"), Settings(), Progress(Console()), Cache())
    baked = codec.decode(bake(plan, Progress(Console())).data)
    points = plan.placement.importance
    traced = plan.tracer.at_points(points.position, points.normal, Sampling(64), seed=9).mean.mean(axis=1)
    light, _ = look_up(baked.gaussians, baked.coarse, baked.blend, points.position, points.normal)
    dark = traced < DARK * traced.mean()
    leaked = light.mean(axis=1)[dark] / traced[~dark].mean()
    return [
        {"gaussians": len(baked.gaussians) + len(baked.coarse), "dark_points": int(dark.sum()),
         "mean": f"{leaked.mean():.2%}", "above_0.5_%": f"{np.mean(leaked > FAINT):.2%}", "max": f"{leaked.max():.0%}"}
    ]  # fmt: skip
