"""A plan as a readable table: what was decided, why, and what it costs."""

from typing import NamedTuple

import numpy as np

from gsgi.baker.surface.budget import COARSE_DEGREE, FINE_BASIS, FINE_DEGREE, PATHS_STEP, coarse_count
from gsgi.baker.trace.tracer import BOUNCES_MAX, PASS_SAMPLES
from gsgi.baker.views.coverage import VIEWS, length

from .effects import findings
from .over.fits import SH_DEGREE
from .plan import Plan

OPERATOR_REASONS = {
    "surface": "Gaussians are read at surface points: no sorting, and few suffice",
    "over": "Gaussians are blended along the ray, as in the paper",
}


class Decision(NamedTuple):
    """One line: the subject, the decision, and its reason or cost."""

    what: str
    decision: str
    why: str


def decisions(plan: Plan) -> list[Decision]:
    """Every decision of a plan, effects first."""
    s, fitted, coverage = plan.settings, plan.placement.fitted, plan.placement.coverage
    placed = sum(name not in plan.scene.cameras and not name.startswith("path ") for name in fitted)
    fine = f"half of the area is seen at {length(coverage.texel_median)} per texel or finer"
    if not np.isfinite(coverage.texel_median):
        fine = f"less than half of the area is seen by {VIEWS} views"
    seen = f"of what people see is seen by {VIEWS} views at {length(coverage.texel_limit)} per texel or finer"
    gaussians = f"{_range(s.budget, plan.most_gaussians)} Gaussians"
    varied = ", as light varies" if plan.most_gaussians > s.budget else ""
    dark = f"; {len(plan.dark)} see no light" if plan.dark else ""
    rows = [
        *((f.name, f.found, f.cost) for f in findings(plan.scene)),
        ("operator", s.operator, OPERATOR_REASONS[s.operator]),
        ("bounces", f"{s.bounces}", _bounces(plan)),
        ("views", f"{len(fitted)}", f"{placed} placed; {len(plan.placement.held_out)} more are held out{dark}"),
        ("coverage", f"{coverage.seen[VIEWS - 1]:.1%}", seen),
        *(_surface_rows(plan) if s.operator == "surface" else _over_rows(plan, fine)),
        ("memory", f"{plan.memory / 1e9:.1f} GB", "at the peak"),
        ("file", f"{plan.file_bytes} bytes", f"at most, with {gaussians}{varied}"),
    ]
    return [Decision(*row) for row in rows]


def _range(least: int, most: int) -> str:
    return f"{least} to {most}" if most > least else f"{least}"


def _bounces(plan: Plan) -> str:
    """Why there are so many bounces."""
    s = plan.settings
    most = s.bounces == BOUNCES_MAX
    rest = "the most that are traced" if most else f"further bounces add {plan.lost or 0:.2%} of the picture"
    if s.bounces == plan.pilot.bounces(s.bounce_fraction):
        return f"{rest}: light goes a long way here, between bright surfaces or into gaps" if most else rest
    return "as requested" if plan.lost is None else f"as requested; {rest}"


def _over_rows(plan: Plan, fine: str) -> list[tuple[str, str, str]]:
    """The decisions that concern only the `over` operator."""
    s = plan.settings
    until = f"until the standard error is below {s.error:.0%} of B plus its mean" if s.error else "all of them"
    least = PASS_SAMPLES if s.error else plan.sampling.samples
    visits = s.iterations / max(len(plan.placement.fitted), 1)
    return [
        ("SH degree", f"{SH_DEGREE}", "surfaces are Lambertian: B is the same from all directions"),
        ("view size", f"{s.size} px", fine),
        ("samples", f"{least} to {plan.sampling.samples}", f"{until}: {plan.samples:.0f} on average"),
        ("fit", f"{s.iterations} steps", f"each view is used {visits:.0f} times{_search(plan)}"),
    ]


def _surface_rows(plan: Plan) -> list[tuple[str, str, str]]:
    """The decisions that concern only the `surface` operator."""
    s = plan.settings
    coarse = coarse_count(s.budget)
    fine = _range(s.budget - coarse, plan.most_gaussians - coarse)
    most = -(-s.samples // PATHS_STEP) * PATHS_STEP
    until = f"until the standard error is below {s.error:.0%} of B there" if s.error else "all of them"
    fewer = f", or {plan.connected_samples:.0f} if connections to lit places pay" if plan.scene.lights else ""
    return [
        ("SH degree", f"{FINE_DEGREE}", f"{COARSE_DEGREE} in the coarse level, which lights moving objects"),
        ("basis", FINE_BASIS, "over the plane of a Gaussian on a surface; constant over one in free space"),
        ("levels", f"{fine} + {coarse}", "Gaussians on surfaces, and in free space"),
        ("known light", f"{plan.known_paths / 1e6:.1f} M", "paths that find B on surfaces, where those of samples end"),
        ("samples", f"{plan.points}", "points on the surfaces that the views see"),
        (
            "paths",
            f"{PATHS_STEP if s.error else most} to {most}",
            f"{until}: about {plan.samples:.0f} per sample{fewer}",
        ),
        ("free space", f"{plan.free_paths / 1e6:.1f} M", "paths from points in free space, for the coarse level"),
        ("fit", f"{plan.fit_steps} steps", f"with half of the samples at first, then with all{_search(plan)}"),
        *_group_rows(plan),
    ]


def _group_rows(plan: Plan) -> list[tuple[str, str, str]]:
    """What light groups cost, if there are some."""
    if not plan.groups:
        return []
    paths = plan.paths(plan.samples) / 1e6
    cost = f"the light of each is traced apart, from the same points, about {paths:.0f} M paths each"
    return [("light groups", f"{len(plan.groups)}", f"{', '.join(plan.groups)}: {cost}")]


def _search(plan: Plan) -> str:
    target = plan.settings.target_loss
    return "" if target is None else f"; again with more Gaussians until the held-out loss is {target:g}"


def summary(plan: Plan) -> str:
    """The decisions that cost the most, as one line for the log."""
    s = plan.settings
    views = len(plan.placement.fitted)
    traced = f"{views} views of {s.size} px, about {plan.samples:.0f} paths per pixel"
    if s.operator == "surface":
        traced = f"{plan.points} surface points in {views} views, about {plan.samples:.0f} paths each"
    gaussians = _range(s.budget, plan.most_gaussians)
    return (
        f"plan: {s.operator}, {s.bounces} bounces, {traced}, {gaussians} Gaussians, {plan.fit_steps} fit steps, "
        f"{plan.memory / 1e9:.1f} GB"
    )
