"""Cost and accuracy of draft, medium and high quality, each bake in a process of its own."""

from pathlib import Path

from repository import SCENES, SHARED

from gsgi.baker.cache.store import entries
from gsgi.baker.settings import QUALITIES

from .dial import CACHE
from .scenes import bake

FILES = (
    SCENES / "cornell.glb",
    SHARED / "modern_hall/modern_hall.gltf",
    SHARED / "sponza_crytek/sponza_sun.gltf",
)


def quality() -> list[dict]:
    """Seconds of the fit until 90 % and 99 % of its PSNR, memory, and accuracy, by scene and quality.

    `fit_s` includes the time before the first step and the evaluations in held-out views. `peak_GB` is that of a
    process that finds its light in the cache, `trace_GB` that of the process before it, which traces what is missing.
    """
    return [row for path in FILES if path.exists() for row in rows_of(path, CACHE)]


def rows_of(path: Path, cache: Path, *flags: str) -> list[dict]:
    """Bake one scene with both operators, each time after a bake that leaves the traced light in the cache."""
    rows = []
    for operator, qualities in QUALITIES.items():
        for name in qualities:
            setting = ("--operator", operator, "--quality", name, *flags)
            traced = bake(path, cache, *setting, "--iterations", "0")
            _forget_fits(cache)
            row = {"scene": path.stem, "operator": operator, "quality": name}
            rows.append(row | row_of(bake(path, cache, *setting)) | {"trace_GB": _gigabytes(traced)})
    return rows


def row_of(report: dict) -> dict:
    """Columns of one bake, from the report of `gsgi bake --json`."""
    tried, mean = report["attempts"][-1], report["held_out"]["mean"]
    scores = {
        f"{prefix}{name}": round(mean[layer][name], 2 if name == "psnr" else 4)
        for prefix, layer in (("", "indirect"), ("final_", "final"))
        for name in ("psnr", "ssim", "ssim_ceiling", "flip")
    }
    return {
        "gaussians": report["gaussians"],
        "bytes": report["bytes"],
        "fit_s": round(tried["fit_s"], 1),
        **{f"to_{share}_s": round(seconds_to(report["history"], share / 100), 1) for share in (90, 99)},
        "peak_GB": _gigabytes(report),
        **scores,
    }


def seconds_to(looks: list[dict], share: float) -> float:
    """Seconds of fitting until the held-out PSNR (dB) has this share of its last value."""
    *before, last = looks
    return next((look["seconds"] for look in before if look["psnr"] >= share * last["psnr"]), last["seconds"])


def _gigabytes(report: dict) -> float:
    return round(report["peak_memory"] / 1e9, 2)


def _forget_fits(cache: Path) -> None:
    """Remove fits from the cache, because a fit that is found there takes no time."""
    for entry in entries(cache):
        if entry.stage in ("fit", "checkpoint"):
            entry.path.unlink(missing_ok=True)
