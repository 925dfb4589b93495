"""Accuracy against cost: the accuracy of budgets in held-out views, and the answers of the budget search."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from repository import ROOT, SCENES, SHARED

from gsgi.baker.bake import bake
from gsgi.baker.budget_search import Attempt, budgets, search
from gsgi.baker.cache.store import Cache, size_limit
from gsgi.baker.cli.console import Console
from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.held_out import ViewEvaluation
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.file import codec
from gsgi.runtime.gltf.reader import read_gltf

from .curve import Curve, draw

FILES = (
    SCENES / "cornell.glb",
    SCENES / "two_rooms.glb",
    SHARED / "modern_hall/modern_hall.gltf",
)
FOLDER = ROOT / "build" / "bench"
CACHE = FOLDER / "cache"  # of traced light: a second run traces nothing

MOST = 16384
BUDGETS = (64, *budgets(MOST))  # all that the search tries, and a smaller one
TARGETS = 8
REPEATED, SEEDS = 2048, 3  # the budget that is fitted with several seeds
SIGNIFICANT = 2 * 2**0.5  # in standard deviations of one fit; it is two of those of the difference between two fits


@dataclass(frozen=True)
class Measured:
    """A fit and its evaluation, the mean over the held-out views."""

    attempt: Attempt
    reached: ViewEvaluation


def dial() -> list[dict]:
    """SSIM, PSNR and FLIP of 64 to 16384 Gaussians, their noise, and the search's answers; draws build/bench/dial.svg.

    A row with a target is the search's answer from the fits above it. A budget between two of those counts as the
    smaller one. A real search fits one such budget at the end, and may save up to 30 % more Gaussians.
    """
    rows, curves, progress = [], [], Progress(Console())
    for path in FILES:
        if path.exists():
            measured, repeated = measure(path, Settings(), progress)
            rows += rows_of(path.stem, measured, repeated)
            curves.append(curve_of(path.stem, measured))
        else:
            progress.say(f"bench: no {path.stem} here, left out")
    FOLDER.mkdir(parents=True, exist_ok=True)
    write_atomic(FOLDER / "dial.svg", draw(curves).encode())
    return rows


def measure(path: Path, settings: Settings, progress: Progress) -> tuple[list[Measured], list[Measured]]:
    """Fit a scene with each of BUDGETS, and with REPEATED for each seed, on which the samples depend too."""
    cache = Cache(CACHE, size_limit(), progress.warn)
    progress.say(f"bench: dial of {path.stem}")
    plan = make_plan(read_gltf(path), settings, progress, cache)
    s = plan.settings
    known = held_out.known_light(plan, progress)
    with progress.stage("references") as advance:
        references = held_out.references(plan, known, advance)
    cache.trim()

    def fit(budget: int, seed: int) -> Measured:
        course = replace(plan, settings=replace(s, budget=budget, seed=seed))
        fitted = bake(course, progress, references).attempt
        return Measured(fitted, held_out.evaluate(references, plan.placement.held_out, codec.decode(fitted.data)).mean)

    measured = [fit(budget, s.seed) for budget in BUDGETS]
    others = [fit(REPEATED, s.seed + i) for i in range(1, SEEDS)]
    return measured, [measured[BUDGETS.index(REPEATED)], *others]


def rows_of(scene: str, measured: list[Measured], repeated: list[Measured]) -> list[dict]:
    """Rows for the fits of a scene, the answers of the search, and the noise of both."""
    answers = list(answers_of(measured))
    loss_sd = np.std([m.attempt.loss for m in repeated], ddof=1)
    ssim_sd = np.std([m.reached.indirect.ssim for m in repeated], ddof=1)
    return [
        *({"scene": scene, "target": ""} | _row(m) for m in measured),
        *(
            {"scene": scene, "target": round(target, 4)}
            | {name: value for name, value in _row(m).items() if name in ("gaussians", "bytes", "loss", "ssim")}
            | {"met": "yes" if m.attempt.loss <= target else "no"}
            for target, m in answers
        ),
        {"scene": scene, "repeated": REPEATED, "loss_sd": f"{loss_sd:.5f}", "ssim_sd": f"{ssim_sd:.5f}",
         "monotone": monotone([m for _, m in answers], SIGNIFICANT * ssim_sd)},
    ]  # fmt: skip


def _row(measured: Measured) -> dict:
    fitted, indirect, final = measured.attempt, measured.reached.indirect, measured.reached.final
    return {
        "gaussians": fitted.count, "bytes": len(fitted.data), "loss": round(fitted.loss, 4),
        "ssim": round(indirect.ssim, 4), "ssim_ceiling": round(indirect.ssim_ceiling, 4),
        "psnr": round(indirect.psnr, 2), "flip": round(indirect.flip, 4), "final_ssim": round(final.ssim, 4),
        "fit_s": round(fitted.seconds, 1),
    }  # fmt: skip


def answers_of(measured: list[Measured]) -> Iterator[tuple[float, Measured]]:
    """Yield targets and the search's answers, from the loosest that costs anything to the tightest that was met."""
    by_budget = {m.attempt.budget: m for m in measured}
    losses = [by_budget[budget].attempt.loss for budget in budgets(MOST)]

    def attempt(budget: int) -> Attempt:
        return by_budget[max(b for b in by_budget if b <= budget)].attempt

    for target in np.geomspace(max(losses), min(losses), TARGETS).tolist():
        yield target, by_budget[search(target, MOST, attempt)[0].budget]


def monotone(answers: list[Measured], margin: float) -> str:
    """Return "yes" if no answer has fewer Gaussians than one to a looser target, or an SSIM worse by `margin`."""
    counts = [m.attempt.count for m in answers]
    ssims = np.array([m.reached.indirect.ssim for m in answers])
    if counts != sorted(counts):
        return "no, fewer Gaussians"
    return "no, worse SSIM" if (ssims < np.maximum.accumulate(ssims) - margin).any() else "yes"


def curve_of(scene: str, measured: list[Measured]) -> Curve:
    """What the plot shows of a scene."""
    points = [(m.attempt.count, m.reached.indirect.ssim) for m in measured]
    return Curve(scene, points, measured[0].reached.indirect.ssim_ceiling)
