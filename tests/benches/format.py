"""Bytes of a file by level and attribute, and what storing B in them costs."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from repository import SCENES

from gsgi.baker.cache.store import Cache
from gsgi.baker.cli.console import Console
from gsgi.baker.evaluation.comparison import compare_indirect
from gsgi.baker.evaluation.held_out import draw, known_light, noisy, references
from gsgi.baker.evaluation.metrics import compare_linear, mean_psnr
from gsgi.baker.evaluation.monitor import FitMonitor
from gsgi.baker.plan import Plan, make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.surface.fits import SurfaceFits
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.display import auto_exposure
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import read_header
from gsgi.runtime.file.levels import _Reader
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.lighting import Lighting, light

from .default_bakes import FOLDER, scene_files
from .scenes import LIGHT

FILES = [SCENES / f"{name}.glb" for name in ("two_rooms", "house")]
WHITE = (1.0, 1.0, 1.0)  # the sky of LIGHT
ATTRIBUTES = {
    "scale": "scale", "normal": "rotation", "angle": "rotation", "position": "position", "opacity": "opacity",
    "green": "light", "red": "light", "blue": "light", "sh1": "sh", "sh2": "sh", "slope": "slope",
}  # fmt: skip


def format() -> list[dict]:
    """Bytes per Gaussian of default bakes, by attribute, with their entropy, and B as stored against B as fitted.

    `psnr` (dB, of linear light), `shown_psnr` (of what the tone curve makes of it) and `ssim` compare B as stored with
    B as fitted; `ssim_lost` is how much less like path tracing it is. All are means over the held-out views, with the
    one level as stored and the other as fitted, each view at its own exposure. In brackets stands the entropy of the
    codes, each taken by itself.
    """
    rows = []
    for file in [*scene_files(), *FILES]:
        plan, bake, truths = fitted(file)
        data = codec.encode(bake)
        stored, images = codec.decode(data), views(plan, bake, truths)
        for level, name in (("fine", "gaussians"), ("coarse", "coarse")):
            changed = views(plan, replace(bake, **{name: getattr(stored, name)}), truths)
            pairs = list(zip(images, changed, truths.values(), strict=True))
            found = [compare_linear(after, before, before, before, auto_exposure(before)) for before, after, _ in pairs]
            lost = [
                compare_indirect(before, truth).ssim - compare_indirect(after, truth).ssim
                for before, after, truth in pairs
            ]
            rows.append({
                "scene": file.stem, "level": level, "gaussians": len(getattr(bake, name)), "bytes": len(data),
                "bytes_per_gaussian": round(sum(size for size, _ in streams(data)[level].values()), 2),
                "psnr": round(mean_psnr([each.psnr for each in found]), 1),
                "shown_psnr": round(mean_psnr([each.shown_psnr for each in found]), 1),
                "ssim": round(float(np.mean([each.ssim for each in found])), 5), "ssim_lost": round(np.mean(lost), 5),
                **{name: f"{size:.2f} ({entropy:.2f})" for name, (size, entropy) in streams(data)[level].items()},
            })  # fmt: skip
    return rows


def fitted(file) -> tuple[Plan, Bake, Mapping[str, Reference]]:
    """A scene's plan, its default bake before it is written, and the references of held-out views that see light."""
    scene = read_gltf(file)
    if file.stem in LIGHT:
        scene = light(scene, Lighting(env=WHITE))
    progress = Progress(Console())
    plan = make_plan(scene, Settings(), progress, Cache(FOLDER / "cache"))

    def bake(fine, coarse) -> Bake:
        return Bake(fine, plan.blend, coarse=coarse)

    iterations = plan.settings.iterations
    fit = SurfaceFits(plan, progress).fit(
        plan.settings.budget,
        lambda advance, coarse: FitMonitor(advance, None, lambda fine: bake(fine, coarse), iterations, None),
    )
    truths = references(plan, known_light(plan, progress), lambda *_: None)
    return plan, bake(fit.gaussians, fit.coarse), {name: truth for name, truth in truths.items() if not noisy(truth)}


def views(plan: Plan, bake: Bake, truths: Mapping[str, Reference]) -> list[np.ndarray]:
    """B (H, W, 3) of a bake in the view of each reference."""
    return [draw(bake, plan.placement.held_out[name], truth) for name, truth in truths.items()]


def streams(data: bytes) -> dict[str, dict[str, tuple[float, float]]]:
    """Bytes and entropy per Gaussian of each attribute, by level."""
    header, sections, *_ = read_header(data)
    found = {}
    for level, (at, end) in sections.items():
        reader = _Measured(header[level], data, at, end, level, lambda *_: None)
        reader.codes()
        reader.sizes["angle"] = end - at - sum(size for size, _ in reader.sizes.values()), 0.0
        found[level] = {}
        count = max(int(header[level]["gaussian_count"]), 1)
        for stream, (size, entropy) in reader.sizes.items():
            attribute = ATTRIBUTES[stream.split("_")[0]]
            before = found[level].get(attribute, (0.0, 0.0))
            # The bits of angles are as they are: they have no entropy of their own to compare.
            found[level][attribute] = before[0] + size / count, before[1] + (entropy or size) / count
    return found


class _Measured(_Reader):
    """A reader that notes the bytes of each stream, and the entropy of its integers in bytes."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.sizes = {}

    def _stream(self, stream: str) -> np.ndarray:
        values = super()._stream(stream)
        _, counts = np.unique(values, return_counts=True)
        self.sizes[stream] = self.at - self.start, float(-(counts * np.log2(counts / len(values))).sum() / 8)
        return values
