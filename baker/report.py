"""The report of a bake, as a record and as JSON."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

from .advice import Advice, advise
from .bake import BakeResult
from .deadline import Deadline
from .evaluation.held_out import Evaluation
from .plan import Plan
from .trace import device


@dataclass(frozen=True)
class BakeReport:
    """The `plan` that was followed, its `result`, and the `warnings`, one line each.

    `evaluation` compares the result with path tracing in held-out views and from the scene's own cameras; None if it
    was not evaluated. `seconds` are by stage. `peak_memory` is that of the process, bytes; None if the system does not
    report it. `deadline` is what was decided for a bake of so many seconds; None if none were asked for.
    """

    plan: Plan
    result: BakeResult
    evaluation: Evaluation | None
    seconds: dict[str, float]
    peak_memory: int | None
    warnings: tuple[str, ...]
    deadline: Deadline | None = None

    @property
    def data(self) -> bytes:
        """Bytes of the .gsgi file."""
        return self.result.data

    @property
    def gaussians(self) -> int:
        """Gaussians in the file, of both levels."""
        return self.result.attempt.count

    @property
    def ssim(self) -> float | None:
        """SSIM of the full frame, mean over the held-out views; None if unknown."""
        return self.evaluation.mean.final.ssim if self.evaluation and self.evaluation.mean else None

    @cached_property
    def advice(self) -> Advice | None:
        """What to turn where a view differs visibly from path tracing, or none can be judged; None if all is well, or
        unknown."""
        return advise(self.plan, self.evaluation) if self.evaluation else None

    @property
    def missed(self) -> str | None:
        """By how much and why the target loss was missed, in one sentence; None if it was met or not asked for."""
        loss, target = self.result.attempt.loss, self.plan.settings.target_loss
        if target is None or loss is None or loss <= target:
            return None
        most = max(attempt.budget for attempt in self.result.attempts)
        reason = "more Gaussians did not help" if most < self.plan.settings.budget else "the budget is spent"
        return (
            f"the loss in held-out views is {loss:.4f} at best, {loss / target - 1:.0%} above the target of "
            f"{target:g}, with {self.gaussians} Gaussians: {reason}"
        )

    def as_dict(self) -> dict:
        """The report as numbers, strings, lists and dictionaries, for JSON."""
        plan, attempt, settings = self.plan, self.result.attempt, self.plan.settings
        coverage = plan.placement.coverage
        return {
            "operator": settings.operator,
            "device": device.title(),
            "gaussians": attempt.count,
            "bytes": len(self.data),
            "budget": plan.gaussians(settings.budget),
            "error": settings.error,
            "iterations": settings.iterations,
            "target_loss": settings.target_loss,
            "deadline": self.deadline
            and {
                "seconds": self.deadline.asked,
                "expected": round(self.deadline.expected, 1),
                "flags": self.deadline.flags,
            },
            "attempts": [
                {
                    "gaussians": attempt.count,
                    "bytes": len(attempt.data),
                    "loss": attempt.loss,
                    "psnr": attempt.psnr,
                    "fit_s": round(attempt.seconds, 3),
                }
                for attempt in self.result.attempts
            ],
            "fine_coverage": None if attempt.coverage is None else round(attempt.coverage, 5),
            "history": [entry._asdict() for entry in attempt.history],
            "light_groups": plan.groups,
            "bounces": settings.bounces,
            "views": len(plan.placement.fitted),
            "view_size": settings.size,
            "samples": round(plan.traced_samples, 1),
            "paths": round(plan.paths(plan.traced_samples)),
            "coverage": [round(share, 4) for share in coverage.seen],
            "texel_limit": coverage.texel_limit,
            "hidden_area": sum(hidden.area for hidden in coverage.hidden),
            **({"kept": plan.kept.as_dict()} if plan.kept else {}),
            "planned_memory": plan.memory,
            "peak_memory": self.peak_memory,
            "stages": [{"stage": name, "seconds": round(value, 3)} for name, value in self.seconds.items()],
            "held_out": dataclasses.asdict(self.evaluation) if self.evaluation else None,
            "advice": dataclasses.asdict(self.advice) if self.advice else None,
        }


def peak_memory() -> int | None:
    """Peak of this process's resident memory, bytes; None if the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
