"""What to turn where a bake differs visibly from path tracing, and what that would cost."""

from collections.abc import Sequence
from dataclasses import dataclass

from .evaluation.held_out import SSIM_GOOD, Evaluation, ViewEvaluation
from .evaluation.summary import look, named
from .plan import Plan, file_bytes
from .settings import BUDGET_MAX, QUALITIES
from .surface_detail import gaussians_for

SSIM_SHORT = 0.02  # of its ceiling: an SSIM that falls shorter
MOTTLE_SEEN = 0.015  # blotches that are stronger are seen on a smooth wall
MORE = 4  # times the Gaussians, as from one quality to the next, or the paths, which halves their noise
SAMPLES_MAX = 1 << 20
SKY = "--env 1,1,1"  # light from all sides, which glTF scenes cannot hold


@dataclass(frozen=True)
class Advice:
    """The `text` in one line, about the worst `view` that falls short, or the noisiest if none can be judged; `option`
    is what to turn first.

    `gaussians` and `bytes` are the most that the file would have with that option; None if that is not known.
    `samples` are more paths, as for `--samples`.
    """

    text: str
    view: str
    option: str | None
    gaussians: int | None
    bytes: int | None
    samples: int


def advise(plan: Plan, evaluation: Evaluation) -> Advice | None:
    """Advise for a bake of `plan`; None if some view can be judged and none falls short.

    It names first what falls short: the SSIM, in the view where it is lowest, or, where none does, the mottle, in the
    view that has most.
    """
    views = *evaluation.views, *evaluation.scene_views
    samples = min(MORE * plan.settings.samples, SAMPLES_MAX)
    more = f"--samples {samples} ({samples / plan.settings.samples:g} times the paths)"
    if views and all(view.noisy for view in views):
        return _unjudged(plan, views, samples, more)
    if not (short := [view for view in views if falls_short(view)]):
        return None
    unlike = [view for view in short if _is_unlike(view)]
    view = min(unlike, key=lambda found: found.final.ssim) if unlike else max(short, key=lambda found: found.mottle)
    option, budget = _turn(plan)
    size = None if budget is None else file_bytes(plan.settings.operator, budget, plan.scene, len(plan.groups))
    turns = [f"{option} (at most {size} bytes)" if size else option] if option else []
    turns += [more]
    found = f"SSIM {view.final.ssim:.4f} (ceiling {view.final.ssim_ceiling:.4f})"
    if unlike:
        wrong = f"differs visibly from path tracing, {found}"
        wrong += "" if view.mottle is None else f", mottle {view.mottle:.1%}"
    else:
        wrong = f"is blotched by {view.mottle:.1%} where its light is smooth (mottle), {found}"
    shown = "" if view is evaluation.worst else look(view)  # of the worst, the line before has told it
    text = f"{named(view)} {wrong}: try {' or '.join(turns)}{shown}"
    return Advice(text, view.name, option, budget, size, samples)


def _unjudged(plan: Plan, views: Sequence[ViewEvaluation], samples: int, more: str) -> Advice:
    """Advice where the references of all `views` are too noisy, as in rooms that get neither sky nor sun."""
    view = min(views, key=lambda found: found.indirect.ssim_ceiling)
    option = SKY if plan.scene.environment is None else None
    turns = f"light the scene by a sky ({option}), or try {more}" if option else f"try {more}"
    text = f"no view can be judged, since hardly any path finds light that reaches what they show: {turns}"
    return Advice(text, view.name, option, None, None, samples)


def falls_short(view: ViewEvaluation) -> bool:
    """Whether one sees that a view differs from its reference, as far as the reference can tell."""
    return not view.noisy and (_is_unlike(view) or (view.mottle or 0) > MOTTLE_SEEN)


def _is_unlike(view: ViewEvaluation) -> bool:
    """Whether the structure of a view differs from that of its reference, as far as the reference can tell."""
    ssim, ceiling = view.final.ssim, view.final.ssim_ceiling
    return ssim < min(SSIM_GOOD, ceiling) or ssim < ceiling - SSIM_SHORT


def _turn(plan: Plan) -> tuple[str | None, int | None]:
    """The option that gives more Gaussians, and the budget that it stands for; None where there are no more."""
    s = plan.settings
    if s.target_loss is not None:
        return f"--target-loss {s.target_loss / 2:.2g}", None
    if s.budget >= BUDGET_MAX:
        return None, None
    budget = min(MORE * plan.gaussians(s.budget), BUDGET_MAX)
    qualities = QUALITIES[s.operator]
    if s.quality != "high" and s.budget == round(
        qualities[s.quality].gaussians * gaussians_for(plan.placement.importance)
    ):
        names = list(qualities)
        return f"--quality {names[names.index(s.quality) + 1]}", budget
    return f"--budget {budget}", budget
