"""What the data of a study says: which settings are enough, which are dominated, and which to use."""

from collections.abc import Sequence
from typing import NamedTuple

GOALS = 0.9, 0.95, 0.98  # SSIM of B
COSTS = {"frame_ms": "ms of a frame", "file_bytes": "bytes on disk", "bake_seconds": "seconds of bake"}


class Wish(NamedTuple):
    """Limits that a setting must keep; None where there is none. Milliseconds are what the light adds to a frame."""

    ssim: float | None = None
    ms: float | None = None
    bytes: int | None = None
    seconds: float | None = None


def cheapest(entries: Sequence[dict], ssim: float) -> list[dict]:
    """Of each method the smallest setting that reaches this SSIM of B, at its lowest resolution; fast frames first.

    All have the paths of a default bake.
    """
    found: dict[str, dict] = {}
    for entry in sorted(entries, key=lambda entry: (entry["value"], -entry["scale"])):
        if entry["paths"] == 1 and entry["mean"]["ssim"] >= ssim:
            found.setdefault(entry["method"], entry)
    return sorted(found.values(), key=lambda entry: entry["frame_ms"])


def compared(entries: Sequence[dict], cost: str) -> list[int]:
    """The places of the entries that count against a cost: other numbers of paths change the seconds of bakes alone."""
    return [i for i, entry in enumerate(entries) if entry["paths"] == 1 or cost == "bake_seconds"]


def dominated(entries: Sequence[dict], cost: str) -> list[bool]:
    """Whether another entry that counts costs no more and has no more error, and is better in one of them.

    What costs nothing here, such as the bytes of path tracing, is paid in every frame: it dominates nothing that costs.
    """
    points = [(entry[cost], 1 - entry["mean"]["ssim"]) for entry in entries]
    others = [points[i] for i in compared(entries, cost)]
    return [
        any(a <= cost and b <= error and (a, b) != (cost, error) and (a > 0 or cost == 0) for a, b in others)
        for cost, error in points
    ]


def recommended(entries: Sequence[dict], wish: Wish) -> tuple[dict | None, str]:
    """The setting of our own bakes to use, and why; None, and what misses the least, if none keeps all limits.

    With a least SSIM it is the smallest file that reaches it, otherwise the most accurate one. Only `surface` counts,
    because it is what `gsgi bake` makes by default; fewer or more paths count where seconds do.
    """
    ours = [e for e in entries if e["method"] == "surface" and (e["paths"] == 1 or wish.seconds is not None)]
    if not ours:
        return None, "the study has no setting of the method `surface`"
    kept = [entry for entry in ours if not _missed(entry, wish)]
    if kept and wish.ssim is not None:
        best = min(kept, key=lambda entry: (entry["file_bytes"], entry["more_ms"]))
        return best, f"the smallest of {len(kept)} settings that keep all limits"
    if kept:
        best = max(kept, key=lambda entry: (entry["mean"]["ssim"], -entry["more_ms"]))
        return best, f"the most accurate of {len(kept)} settings that keep all limits"
    nearest = min(ours, key=lambda entry: max(excess for _, excess in _missed(entry, wish)))
    missed = "; ".join(text for text, _ in _missed(nearest, wish))
    reason = f"none of {len(ours)} settings keeps all limits; nearest is {nearest['label']}: {missed}"
    return None, f"{reason}: {nearest['command']}"


def _missed(entry: dict, wish: Wish) -> list[tuple[str, float]]:
    """The limits that an entry misses, in words, each with how far: the ratio of what it has to what was asked for."""
    ssim = entry["mean"]["ssim"]
    found = []
    if wish.ssim is not None and ssim < wish.ssim:
        text = f"SSIM {ssim:.4f} where {wish.ssim:g} is asked for"
        found.append((text, (1 - ssim) / max(1 - wish.ssim, 1e-6)))
    for name, limit, what in (
        ("more_ms", wish.ms, "ms of light"),
        ("file_bytes", wish.bytes, "bytes"),
        ("bake_seconds", wish.seconds, "s of bake"),
    ):
        if limit is not None and entry[name] > limit:
            found.append((f"{entry[name]:,.4g} {what} where {limit:,g} are asked for", entry[name] / limit))
    return found
