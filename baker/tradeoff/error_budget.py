"""Where the error of our default bake sits: each cause alone, taken away or halved."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.comparison import compare_frame, compare_indirect
from gsgi.baker.evaluation.metrics import mean_psnr
from gsgi.baker.evaluation.monitor import FitMonitor
from gsgi.baker.progress import Progress
from gsgi.baker.surface.fits import SurfaceFits
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians

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
    ours = [entry for entry in entries if entry.method.name == "surface"]
    default = next((e for e in ours if e.value == ground.plan.settings.budget and e.scale == 1), None)
    if default is None:
        return None
    parts = [*_of_the_fit(ground), *_of_entries(default, ours), _of_shadows(ground, ctx)]
    return {"about": ABOUT, "parts": [asdict(part) for part in parts]}


def _of_the_fit(ground: Ground) -> list[Part]:
    """Tracing noise, quantisation and the coarse level."""
    settings = ground.plan.settings
    as_is, seconds = _fitted(ground, settings.samples, settings.error)
    twice, longer = _fitted(ground, 2 * settings.samples, settings.error / np.sqrt(2))
    data = codec.encode(as_is)
    written = codec.decode(data)
    dark = replace(written.coarse, opacity=np.zeros_like(written.coarse.opacity))
    before, finer, quieter, fine_only = (
        _score(ground, bake) for bake in (written, as_is, twice, replace(written, coarse=dark))
    )
    floats = sum(sum(getattr(level, name).nbytes for name in level.__dataclass_fields__) for level in _levels(as_is))
    return [
        Part("tracing noise", "twice the paths", *before, *quieter, f"{longer - seconds:.0f} s more of tracing"),
        Part("quantisation", "floats in place of bytes", *before, *finer, f"{floats / len(data):.1f} times the bytes"),
        Part("no coarse level", "it is there", *fine_only, *before, f"{len(written.coarse)} Gaussians"),
    ]


def _fitted(ground: Ground, samples: int, error: float) -> tuple[Bake, float]:
    """The default bake with so many paths, before it is written, and the seconds of its tracing."""
    settings = replace(ground.plan.settings, samples=samples, error=error)
    plan = replace(ground.plan, settings=settings)
    progress = Progress(ground.display)

    def bake(fine: Gaussians, coarse: Gaussians | None) -> Bake:
        return Bake(fine, plan.blend, ground.tone_scale, coarse=coarse)

    fit = SurfaceFits(plan, progress).fit(
        settings.budget,
        lambda advance, coarse: FitMonitor(advance, None, lambda fine: bake(fine, coarse), settings.iterations, None),
    )
    return bake(fit.gaussians, fit.coarse), progress.seconds["irradiance"]


def _of_entries(default: Entry, ours: Sequence[Entry]) -> list[Part]:
    """The number of Gaussians, and the resolution of the pass."""
    parts = []
    larger = min((e for e in ours if e.scale == 1 and e.value > default.value), key=lambda e: e.value, default=None)
    if larger is not None:
        longer = larger.bake_seconds - default.bake_seconds
        cost = (
            f"{larger.file_bytes - default.file_bytes} bytes, {longer:.0f} s of bake, "
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


def _levels(bake: Bake) -> list[Gaussians]:
    return [bake.gaussians, bake.coarse]
