"""The lines of the log that tell what an evaluation found."""

from .comparison import Comparison
from .group_error import GroupError
from .held_out import Evaluation, ViewEvaluation
from .metrics import PSNR_MAX


def summary(evaluation: Evaluation) -> list[str]:
    """One line for each view, then the mean of the held-out views, the light groups, and the worst of all views."""
    lines = [_line(view) for view in (*evaluation.views, *evaluation.scene_views)]
    if evaluation.mean:
        lines.append(_line(evaluation.mean))
    if evaluation.bias:
        found = evaluation.bias
        lines.append(f"references: {found.bias:+.2%} of whole paths' light (+- {found.standard_error:.2%})")
    if evaluation.moving:
        lines.append(f"things that move: {evaluation.moving.told('before these views')}")
    if evaluation.films:
        lines.append(f"what lets light through: {evaluation.films.told('that these views see of it')}")
    lines += [_group_line(group) for group in evaluation.groups]
    if evaluation.worst:
        worst = evaluation.worst
        lines.append(
            f"worst view: {named(worst)}, SSIM of the frame {worst.final.ssim:.4f}{_shares(worst)}{look(worst)}"
        )
    return lines


def _group_line(group: GroupError) -> str:
    if group.error is None:
        return f"light group {group.name}: it lights none of these views"
    return f"light group {group.name} alone: B is off by {group.error:.1%} RMS, at most by {group.bound:.1%}"


def named(view: ViewEvaluation) -> str:
    """The view's name, marked if it is of a camera of the scene."""
    return f"{view.name} (camera of the scene)" if view.of_scene else view.name


def look(view: ViewEvaluation) -> str:
    """How to look at a view that was placed; "" for a camera of the scene, which has a name."""
    return f"; `gsgi render` shows it with {view.flags}" if view.flags and not view.of_scene else ""


def _line(view: ViewEvaluation) -> str:
    if view.noisy:
        noise = f"its reference is too noisy (ceiling {view.indirect.ssim_ceiling:.4f})"
        return f"{named(view)}: left out, as {noise}{_leak(view)}"
    layers = f"B: {_told(view.indirect)}; frame: {_told(view.final)}"
    return f"{named(view)}: loss {view.loss:.4f}; {layers}{_shares(view)}"


def _told(found: Comparison) -> str:
    psnr = f"PSNR {found.shown_psnr:.2f} dB" if found.psnr < PSNR_MAX else "error below the reference's noise"
    return f"{psnr}, SSIM {found.ssim:.4f} (ceiling {found.ssim_ceiling:.4f}), FLIP {found.flip:.4f}"


def _shares(view: ViewEvaluation) -> str:
    mottle = "" if view.mottle is None else f"; mottle {view.mottle:.1%}"
    return mottle + _leak(view)


def _leak(view: ViewEvaluation) -> str:
    return "" if view.leak is None else f"; leak {view.leak:.1%}"
