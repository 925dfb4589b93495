"""Where the time of our bakes goes, against their error: over the number of Gaussians, and over that of the paths."""

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple

from .drawing import GREY, INK, Axis, Box, Dot, Line, Text
from .plots import LEFT, RIGHT, TOP, error_of, grid, swept

NAMES = "more or fewer Gaussians", "more or fewer paths"
COLOURS = "#d55e00", "#0072b2"
STAGES = {
    "views": "#bdbdbd", "plan": "#8f8f8f", "known light": "#56b4e9", "irradiance": "#0072b2", "fit": "#d55e00",
    "encode": "#222222",
}  # fmt: skip
OTHER = "#a05195"

BOTTOM, BARS = 330, 424  # px; where the curves end, and where the bars begin
ROW, BAR = 24, 16  # px; height of a row and of its bar
FIRST, LAST = 240, 560  # px; the bars


def ours(study: dict) -> list[list[int]]:
    """The places of our bakes as two lines, over their Gaussians and over their paths; none unless there are both."""
    entries = study["entries"]
    lines = swept(study, [i for i, e in enumerate(entries) if e["method"] == "surface" and e["scale"] == 1])
    return lines if len(lines) == len(NAMES) else []


def height(study: dict) -> int:
    """Height of the plot, px."""
    return BARS + ROW * len(_rows(study)) + 24


def shapes(study: dict) -> list[NamedTuple]:
    """What the plot is made of, from back to front: a curve over each of the two, and the seconds of each stage."""
    return [*_curves(study), *_bars(study)] if ours(study) else []


def _curves(study: dict) -> Iterator[NamedTuple]:
    entries, places = study["entries"], [i for line in ours(study) for i in line]
    limit = error_of(study["ceiling"])
    costs = [math.log10(entries[i]["bake_seconds"]) for i in places]
    errors = [math.log10(error) for error in (limit, *(error_of(entries[i]["mean"]["ssim"]) for i in places))]
    x = Axis(min(costs) - 0.1, max(*costs, min(costs) + 0.4) + 0.1, LEFT, RIGHT)
    y = Axis(min(errors) - 0.15, max(*errors, min(errors) + 0.2) + 0.15, BOTTOM, TOP)
    yield from grid(x, y, limit, "What seconds of bake buy", "", "seconds of bake")
    for line, name, colour, above in zip(ours(study), NAMES, COLOURS, (True, False), strict=True):
        points = [(x.at(entries[i]["bake_seconds"]), y.at(error_of(entries[i]["mean"]["ssim"]))) for i in line]
        yield Line(tuple(points), colour, 1.5)
        for i, (left, top) in zip(line, points, strict=True):
            yield Dot((left, top), colour, i)
            entry = entries[i]
            if above:
                yield Text((left + 7, top - 6), f"{entry['value']:,.0f}", colour, size=11)
            else:
                yield Text((left, top + 18), _factor(entry["paths"]), colour, "middle", 11)
        row = TOP + (10 if above else 52)
        yield Box((RIGHT + 18, row - 9), (RIGHT + 28, row + 1), colour)
        yield Text((RIGHT + 34, row), name, INK)
        yield Text((RIGHT + 34, row + 16), "default paths" if above else "default Gaussians", GREY, size=11)


def _bars(study: dict) -> Iterator[NamedTuple]:
    entries, rows = study["entries"], _rows(study)
    longest = max(entries[i]["bake_seconds"] for i in rows)
    stages = list(dict.fromkeys(stage for i in rows for stage in entries[i]["seconds"]))
    left = LEFT
    for stage in stages:
        yield Box((left, BARS - 24), (left + 10, BARS - 14), STAGES.get(stage, OTHER))
        yield Text((left + 15, BARS - 15), stage, INK, size=11)
        left += 34 + 6.5 * len(stage)
    for row, i in enumerate(rows):
        top, at = BARS + ROW * row, float(FIRST)
        yield Text((FIRST - 10, top + 12), entries[i]["label"], INK, "end", 11)
        for stage in stages:
            end = at + entries[i]["seconds"].get(stage, 0.0) / longest * (LAST - FIRST)
            yield Box((at, top), (end, top + BAR), STAGES.get(stage, OTHER))
            at = end
        words = f"{entries[i]['bake_seconds']:.3g} s, SSIM {entries[i]['mean']['ssim']:.4f}"
        yield Text((at + 8, top + 12), words, GREY, size=11)


def _rows(study: dict) -> Sequence[int]:
    """The places of all our bakes, the default one once."""
    return list(dict.fromkeys(i for line in ours(study) for i in line))


def _factor(paths: float) -> str:
    return f"{Fraction(paths)}" if paths < 1 else f"{paths:g}"
