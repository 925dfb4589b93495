"""How default bakes look, view by view, each at its own exposure: structure, mottle in smooth light, and leaks."""

import tempfile
from pathlib import Path

from repository import SCENES, SHARED

from .scenes import bake

FILES = (
    SCENES / "cornell.glb",
    SCENES / "two_rooms.glb",
    SCENES / "house.glb",
    SCENES / "gaps.glb",
    SCENES / "cells.glb",
    SCENES / "corridor.glb",
    SCENES / "metals.glb",
    SCENES / "conservatory.glb",
    SHARED / "modern_hall" / "modern_hall.gltf",
    SHARED / "breakfast_room" / "breakfast_room_sun.gltf",
    SHARED / "sponza_crytek" / "sponza_sun.gltf",
    SHARED / "veach_ajar" / "veach_ajar.gltf",
    SHARED / "veach_bidir" / "veach_bidir.gltf",
)


def looks() -> list[dict]:
    """SSIM of the frame with its ceiling, mottle and leak of B, in held-out views and from the scene's cameras."""
    return [row for path in FILES if path.exists() for row in rows_of(path)]


def rows_of(path: Path) -> list[dict]:
    """The views of one default bake, then their worst."""
    with tempfile.TemporaryDirectory() as cache:
        report = bake(path, Path(cache))
    found = report["held_out"]
    return [_row(path, view) for view in (*found["views"], *found["scene_views"])] + [
        _row(path, found["worst"]) | {"view": f"worst: {found['worst']['name']}"}
    ]


def _row(path: Path, view: dict) -> dict:
    final = view["final"]
    figures = {"ssim": final["ssim"], "ceiling": final["ssim_ceiling"], "mottle": view["mottle"], "leak": view["leak"]}
    rounded = {name: None if value is None else round(value, 4) for name, value in figures.items()}
    return {"scene": path.stem, "view": view["name"]} | rounded
