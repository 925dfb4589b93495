"""The operators `over` and `surface` side by side: accuracy, size, seconds of baking, milliseconds of drawing."""

from itertools import pairwise
from pathlib import Path

from gsgi.runtime.gl.surface_splat import SCALES

from .operator_bakes import Kept, default, over_bakes, scene_files, surface_bakes
from .operator_frames import splat_ms, ssim_to_full

EQUAL_TO = "medium", "high"  # qualities of `over` whose SSIM `surface` has to reach


def operator_bakes() -> list[dict]:
    """Both operators from few to many Gaussians: size, seconds with an empty cache, B in held-out views, splat pass."""
    return [_row(kept) for path in scene_files() for kept in [*over_bakes(path), *surface_bakes(path)]]


def operator_equal() -> list[dict]:
    """Cost of the smallest `surface` bake that reaches the SSIM of B of an `over` bake, as shares of the latter's cost.

    `interpolated` is the share of Gaussians that a `surface` bake with exactly that SSIM would have.
    """
    return [_equal_row(*match) for path in scene_files() for match in matches(path)]


def operator_scales() -> list[dict]:
    """The splat pass of these `surface` bakes and the default one at each splat scale; SSIM of B to full resolution.

    The default bake is compared with the default bake of `over`.
    """
    rows = []
    for path in scene_files():
        for over, surface in [*matches(path), (default(over_bakes(path)), default(surface_bakes(path)))]:
            of_over = splat_ms(over)
            for scale in SCALES:
                ms, ssim = splat_ms(surface, scale), ssim_to_full(surface, scale)
                rows.append(
                    {"scene": path.stem, "over": over.setting, "surface": surface.setting, "splat_scale": scale}
                    | {"splat_ms": round(ms, 1), "of_over": round(ms / of_over, 2), "ssim_to_full": round(ssim, 5)}
                )
    return rows


def matches(path: Path) -> list[tuple[Kept, Kept]]:
    """Bakes of `over`, each with the smallest bake of `surface` that reaches its SSIM, else with the best."""
    surface = surface_bakes(path)
    return [(over, smallest(surface, over.ssim)) for over in over_bakes(path) if over.setting in EQUAL_TO]


def smallest(bakes: list[Kept], ssim: float) -> Kept:
    """The bake with the fewest Gaussians that reaches an SSIM; if none does, the one with the highest."""
    reaching = [bake for bake in bakes if bake.ssim >= ssim]
    return min(reaching, key=lambda bake: bake.gaussians) if reaching else max(bakes, key=lambda bake: bake.ssim)


def gaussians_at(bakes: list[Kept], ssim: float) -> float | None:
    """How many Gaussians reach an SSIM, interpolated between bakes linearly in the logarithm of the number.

    `bakes` are sorted by ascending number. The result is the number of the first bake if that reaches the SSIM already,
    and None if no bake reaches it.
    """
    if bakes[0].ssim >= ssim:
        return float(bakes[0].gaussians)
    for below, above in pairwise(bakes):
        if above.ssim >= ssim:
            share = (ssim - below.ssim) / (above.ssim - below.ssim)
            return float(below.gaussians ** (1 - share) * above.gaussians**share)
    return None


def _row(kept: Kept) -> dict:
    mean = kept.report["held_out"]["mean"]
    coarse = kept.read().coarse
    return {
        "scene": kept.scene.stem,
        "operator": kept.operator,
        "setting": kept.setting,
        "gaussians": kept.gaussians,
        "coarse": 0 if coarse is None else len(coarse),
        "bytes": kept.report["bytes"],
        "trace_s": round(kept.trace_s, 1),
        "fit_s": round(kept.fit_s, 1),
        "ssim": round(kept.ssim, 4),
        "ssim_ceiling": round(mean["indirect"]["ssim_ceiling"], 4),
        "psnr": round(mean["indirect"]["psnr"], 2),
        "loss": round(mean["loss"], 4),
        "frame_ssim": round(mean["final"]["ssim"], 4),
        "splat_ms": round(splat_ms(kept), 1),
    }


def _equal_row(over: Kept, surface: Kept) -> dict:
    def share(of_surface: float | None, of_over: float) -> float | str:
        return "" if of_surface is None else round(of_surface / of_over, 3)

    return {
        "scene": over.scene.stem,
        "equal_to": over.setting,
        "over_ssim": round(over.ssim, 4),
        "surface_ssim": round(surface.ssim, 4),
        "reached": "yes" if surface.ssim >= over.ssim else "no",
        "gaussians": share(surface.gaussians, over.gaussians),
        "interpolated": share(gaussians_at(surface_bakes(over.scene), over.ssim), over.gaussians),
        "bytes": share(surface.report["bytes"], over.report["bytes"]),
        "bake_s": share(surface.trace_s + surface.fit_s, over.trace_s + over.fit_s),
        "splat_ms": share(splat_ms(surface), splat_ms(over)),
    }
