"""Costs of the passes of the last frames, as lines of text."""

from collections.abc import Sequence

from gsgi.runtime.gl.profile import PassCost


def cost_table(frames: Sequence[Sequence[PassCost]]) -> str:
    """Mean GPU and CPU milliseconds over frames of the same passes, and their sums. Empty for no frames."""
    if not frames:
        return ""
    sums: dict[str, list[float]] = {}
    for frame in frames:
        for cost in frame:
            row = sums.setdefault(cost.name, [0.0, 0.0])
            row[0] += cost.gpu_ms
            row[1] += cost.cpu_ms
    rows = [(name, gpu / len(frames), cpu / len(frames)) for name, (gpu, cpu) in sums.items()]
    rows.append(("all", sum(gpu for _, gpu, _ in rows), sum(cpu for *_, cpu in rows)))
    width = max(len(name) for name, *_ in rows)
    head = f"{'pass':<{width}}{'gpu ms':>8}{'cpu ms':>8}"
    return "\n".join([head, *(f"{name:<{width}}{gpu:>8.2f}{cpu:>8.2f}" for name, gpu, cpu in rows)])
