"""The placement of views as a cached task: where nothing it depends on has changed, no view is placed again."""

import dataclasses
import json

import numpy as np

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.together import together
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.runtime.camera import Camera

from .coverage import Coverage, Hidden
from .importance import ImportanceField
from .placement import Placement, place
from .surface_points import Triangles

PACKAGES = ("open3d", "numpy")


def place_once(
    tracer: CachedTracer, triangles: Triangles, given: dict[str, Camera], size: int, seed: int, count: int | None
) -> tuple[Placement, bool]:
    """The result of `place` for the `triangles` of the tracer's scene, and whether it was in the tracer's cache.

    While views are placed the tracer starts, since their light is traced next.
    """
    inputs = {"names": list(given), "given": given, "size": size, "seed": seed, "count": count, "box": triangles.box}
    key = tracer.key("placement", __name__, placed_by=code_version(__name__, PACKAGES), **inputs)
    if found := tracer.cache.get(key):
        return placement_of(found), True
    placement, _ = together(lambda: place(triangles, given, size, seed, count), tracer.start)
    tracer.cache.put(key, placement_arrays(placement))
    return placement, False


def placement_arrays(placement: Placement) -> dict[str, np.ndarray]:
    """Cameras and coverage as JSON, in which float64 keeps all its bits, and the field of importance as it is."""
    rest = {name: value for name, value in vars(placement).items() if name != "importance"}
    text = json.dumps(rest, default=_plain)
    return {"json": np.frombuffer(text.encode(), np.uint8), **to_arrays(placement.importance)}


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else dataclasses.asdict(value)


def placement_of(arrays: dict[str, np.ndarray]) -> Placement:
    """The placement that `placement_arrays` took apart."""
    read = json.loads(arrays["json"].tobytes())
    coverage = read["coverage"]
    coverage |= {"seen": tuple(coverage["seen"]), "hidden": tuple(Hidden(**hidden) for hidden in coverage["hidden"])}
    importance = from_arrays(ImportanceField, arrays)
    return Placement(_cameras(read["fitted"]), _cameras(read["held_out"]), Coverage(**coverage), importance)


def _cameras(read: dict[str, dict]) -> dict[str, Camera]:
    return {
        name: Camera(**camera | {"world_from_view": np.array(camera["world_from_view"])})
        for name, camera in read.items()
    }
