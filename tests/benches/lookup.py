"""The look-up at single points: lists, bytes, seconds."""

import time

import numpy as np
from surface_frames import seen_points

from benches.splats import fastest, grid, on_surfaces, room
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend
from gsgi.runtime.gltf.reader import read_gltf

COUNTS = 1_000, 10_000
FRAME = 160, 90  # px, of the frames whose surfaces are looked up
POINTS = 20_000  # on surfaces, for the lists


def lookup_lists() -> list[dict]:
    """Lists of the fine level: Gaussians listed per Gaussian that reaches a surface point, bytes on the GPU, build."""
    from gsgi.baker.views.surface_points import Triangles

    points, rows = Triangles(room()).sample(POINTS, seed=1).position, []
    for count in COUNTS:
        bake = bake_of(count)
        rows.append({"gaussians": count} | lists_of(bake.gaussians, bake.blend.radius, points))
    return rows


def lookup_bakes() -> list[dict]:
    """The same of both levels of default bakes, at what the cameras of their scenes see."""
    from gsgi.runtime.cell_lists import COARSE_PRICE
    from gsgi.runtime.gl.context import create_context
    from gsgi.runtime.gl.renderer import DeferredRenderer

    from .default_bakes import default_bake, scene_files

    ctx, rows = create_context(), []
    for path in scene_files():
        scene, bake = read_gltf(path), default_bake(path, "surface").read()
        renderer, seen = DeferredRenderer(ctx, scene, bake, *FRAME), []
        for camera in scene.cameras.values():
            renderer.render(camera)
            depth = renderer.read("depth").reshape(FRAME[::-1])
            seen.append(seen_points(depth, camera)[depth > 0])
        renderer.release()
        for name, level, price in (("fine", bake.gaussians, 1), ("coarse", bake.coarse, COARSE_PRICE)):
            named = {"scene": path.stem, "level": name, "gaussians": len(level)}
            rows.append(named | lists_of(level, bake.blend.radius, np.concatenate(seen).astype(np.float32), price))
    return rows


def lists_of(level: Gaussians, radius: float, points: np.ndarray, price: int = 1) -> dict:
    """What the lists of a level cost, and hold at points (N, 3)."""
    from gsgi.runtime.cell_lists import cell_lists

    lists = cell_lists(level, radius, price)
    listed, reaching = pairs(lists, level, radius, points)
    count, inner = np.diff(lists.first), lists.child > 0
    words = ((count > 0) | inner).sum() + 2 * inner.sum() + ((count + 1) // 2 + count).sum()
    return {
        "reach": round(reaching / len(points), 1), "listed": round(listed / len(points), 1),
        "listed_per_reach": round(listed / reaching, 2),
        "build_ms": round(1e3 * fastest({(): lambda: cell_lists(level, radius, price)})[()]),
        "lists_kB": round((4 * len(lists.child) + 2 * words) / 1e3),
    }  # fmt: skip


def lookup_points() -> list[dict]:
    """Seconds of gsgi.sample() for a million points on surfaces."""
    import gsgi
    from gsgi.baker.views.surface_points import Triangles

    points, rows = Triangles(room()).sample(POINTS, seed=1), []
    many = np.random.default_rng(0).integers(POINTS, size=1_000_000)
    for count in COUNTS:
        sampler = gsgi.Sampler(bake_of(count))
        start = time.perf_counter()
        sampler.sample(points.position[many], points.normal[many])
        rows.append({"gaussians": count, "points": len(many), "seconds": round(time.perf_counter() - start, 2)})
    return rows


def bake_of(count: int) -> Bake:
    return Bake(on_surfaces(count), SurfaceBlend(), coarse=grid())


def pairs(lists, level, radius: float, position: np.ndarray) -> tuple[int, int]:
    """How many Gaussians are listed for points (N, 3), and how many reach them, in sum."""
    from gsgi.runtime.quaternions import rotation_matrices

    whiten = rotation_matrices(level.rotation) / level.scale[:, None, :]
    first, entry = lists.by_octant()
    listed = reaching = 0
    for index, octant in lists.descend(position):
        count = first[octant + 1] - first[octant]
        point = np.repeat(index, count)
        step = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
        gaussian = entry[np.repeat(first[octant], count) + step]
        e = np.einsum("pi,pij->pj", position[point] - level.position[gaussian], whiten[gaussian])
        listed, reaching = listed + len(point), reaching + int(((e * e).sum(axis=1) <= radius**2).sum())
    return listed, reaching
