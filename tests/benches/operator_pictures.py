"""Pictures of both operators, and of their errors, beside path tracing."""

from pathlib import Path

import numpy as np

from gsgi.baker.evaluation.held_out import draw
from gsgi.baker.evaluation.pictures import panels
from gsgi.baker.trace import reference
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.display import auto_exposure, tone_map
from gsgi.runtime.image import write_image

from .dial import FOLDER
from .operator_bakes import Kept, default, over_bakes, scene_files, surface_bakes
from .operator_frames import held_out_cameras, lit_scene

SIZE, SAMPLES = 160, 512
AMPLIFIED = 4  # factor on the differences
PICTURE = FOLDER / "operators.png"


def operator_pictures() -> list[dict]:
    """B of the best `over` bake, the default `surface` bake and path tracing; draws build/bench/operators.png.

    Shows, of each scene, the held-out view in which `surface` has the largest lead in SSIM, or the smallest lag.
    """
    rows, made = [], []
    for path in scene_files():
        over = max(over_bakes(path), key=lambda kept: kept.ssim)
        surface = default(surface_bakes(path))
        made.append(_row(path, over, surface))
        rows.append({"scene": path.stem, "over": over.gaussians, "surface": surface.gaussians, "file": PICTURE.name})
    if made:
        write_image(PICTURE, np.concatenate(made))
    return rows


def _row(path: Path, over: Kept, surface: Kept) -> np.ndarray:
    """One row of the picture, (H, W, 3) uint8."""
    view = max(range(len(held_out_cameras(over))), key=lambda i: _ssim(surface, i) - _ssim(over, i))
    camera = held_out_cameras(over)[view]
    truth = reference.trace(Tracer(lit_scene(path)), camera, SIZE, SIZE, SAMPLES, seed=0)
    exposure = auto_exposure(truth.clean)
    seen = tone_map(np.where(truth.valid[..., None], truth.clean, 0), exposure)
    pictures = {}
    for kept in (over, surface):
        light = tone_map(np.where(truth.valid[..., None], draw(kept.read(), camera, truth), 0), exposure)
        pictures[f"{kept.operator}: {kept.gaussians:,}"] = light
        pictures[f"{kept.operator}: {AMPLIFIED} x error"] = np.clip(AMPLIFIED * np.abs(light - seen), 0, 1)
    return panels(pictures | {"path-traced": seen})


def _ssim(kept: Kept, view: int) -> float:
    return kept.report["held_out"]["views"][view]["indirect"]["ssim"]
