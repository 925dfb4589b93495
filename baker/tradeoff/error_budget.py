"""Where the error of our default bake sits: each cause alone, taken away or halved."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.comparison import compare_frame, compare_indirect
from gsgi.baker.evaluation.metrics import mean_psnr
from gsgi.runtime.gaussians import Bake

from .gaussians import SURFACE
from .ground import Ground
from .study import MAGNIFIED, Entry

if TYPE_CHECKING:
    import moderngl

ABOUT = (
    "The default bake, with one cause of error at a time taken away or halved. The rows are of B, the last one of the "
    "frame with exact indirect light. A figure at its ceiling cannot tell more."
)


@dataclass(frozen=True)
class Part:
    """One cause of error: SSIM and PSNR (dB) with it and `without`, how it was taken away, and what that costs."""

    part: str
    limit: str
    ssim: float
    psnr: float
    ssim_without: float
    psnr_without: float
    cost: str


def error_budget(ground: Ground, entries: Sequence[Entry], ctx: "moderngl.Context") -> dict | None:
    """The budget as data for the report; None without entries of the method `surface` around the default budget."""
    ours = [entry for entry in entries if entry.method.name == SURFACE.name]
    default = next((e for e in ours if e.value == ground.plan.settings.budget and e.paths == e.scale == 1), None)
    if default is None:
        return None
    parts = [*_of_entries(default, ours), *_of_the_file(ground, default), _of_shadows(ground, ctx)]
    return {"about": ABOUT, "parts": [asdict(part) for part in parts]}


def _of_the_file(ground: Ground, default: Entry) -> list[Part]:
    """Quantisation and the coarse level."""
    baked, _ = ground.bake(SURFACE, default.value)
    written = baked.bake
    dark = replace(written.coarse, opacity=np.zeros_like(written.coarse.opacity))
    before, exact, fine_only = (_score(ground, bake) for bake in (written, baked.exact, replace(written, coarse=dark)))
    floats = sum(
        sum(getattr(level, name).nbytes for name in level.__dataclass_fields__) for level in (baked.fine, baked.coarse)
    )
    cost = f"{floats / default.file_bytes:.1f} times the bytes"
    return [
        Part("quantisation", "floats in place of bytes", *before, *exact, cost),
        Part("no coarse level", "it is there", *fine_only, *before, f"{len(written.coarse)} Gaussians"),
    ]


def _of_entries(default: Entry, ours: Sequence[Entry]) -> list[Part]:
    """Tracing noise, the number of Gaussians, and the resolution of the pass."""
    parts, full = [], [entry for entry in ours if entry.scale == 1]
    longer = max((e for e in full if e.paths > 1), key=lambda e: e.paths, default=None)
    if longer is not None:
        cost = f"{longer.bake_seconds - default.bake_seconds:.0f} s of bake"
        limit = f"{longer.paths:g} times the paths"
        parts.append(Part("tracing noise", limit, *_of_mean(default), *_of_mean(longer), cost))
    larger = min((e for e in full if e.value > default.value), key=lambda e: e.value, default=None)
    if larger is not None:
        more = larger.bake_seconds - default.bake_seconds
        cost = (
            f"{larger.file_bytes - default.file_bytes} bytes, {more:.0f} s of bake, "
            f"{larger.more_ms - default.more_ms:.1f} ms of a frame more"
        )
        limit = f"{larger.value / default.value:g} times as many"
        parts.append(Part("number of Gaussians", limit, *_of_mean(default), *_of_mean(larger), cost))
    for coarser in (e for e in ours if e.value == default.value and e.scale > 1):
        cost = f"{default.more_ms - coarser.more_ms:.1f} ms of a frame"
        name = f"1/{coarser.scale} resolution of the pass"
        parts.append(Part(name, "full resolution", *_of_mean(coarser), *_of_mean(default), cost))
    return parts


def _of_shadows(ground: Ground, ctx: "moderngl.Context") -> Part:
    """Shadow maps of the primary light: the frame's own primary light with the reference's indirect light."""
    from .gl.frame import Frame

    edge, middle = MAGNIFIED * held_out.SIZE, slice(MAGNIFIED // 2, None, MAGNIFIED)
    frame = Frame(ctx, ground.scene, (edge, edge))
    drawn, exact = [], []
    for name, reference in ground.references.items():
        reflected = reference.surface.albedo * reference.clean
        exposed = held_out.exposure(reference.final, ground.tone_scale)
        primary = frame.primary(ground.cameras[name])[middle, middle]
        drawn.append(compare_frame(primary + reflected, reference, exposed))
        exact.append(compare_frame(reference.primary + reflected, reference, exposed))
    frame.release()
    return Part("shadow maps of primary light", "exact shadows", *_mean(drawn), *_mean(exact), "rays in place of maps")


def _score(ground: Ground, bake: Bake) -> tuple[float, float]:
    """SSIM and PSNR of B, means over the views."""
    found = []
    for name, reference in ground.references.items():
        image = held_out.draw(bake, ground.cameras[name], reference)
        exposed = held_out.exposure(reference.indirect, ground.tone_scale)
        found.append(compare_indirect(image, reference, exposed))
    return _mean(found)


def _mean(found) -> tuple[float, float]:
    return float(np.mean([each.ssim for each in found])), mean_psnr([each.psnr for each in found])


def _of_mean(entry: Entry) -> tuple[float, float]:
    return entry.mean.ssim, entry.mean.psnr
