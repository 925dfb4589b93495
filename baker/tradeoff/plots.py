"""Log-log plots of error against cost."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from .drawing import BAND, GREY, INK, RULE, Axis, Box, Dot, Line, Text, short
from .ranking import COSTS, compared

# After Okabe and Ito (2008): distinguishable with any colour vision, and dark enough on white.
COLOURS = {
    "surface": "#d55e00", "over": "#e69f00", "lightmap": "#56b4e9", "lightmap-denoised": "#0072b2",
    "probes": "#66c2a5", "probes-visibility": "#008a64", "radiosity": "#b5a300", "light-volume": "#8c564b",
    "voxel-cones": "#b2182b", "path-tracing": "#cc79a7", "path-tracing-denoised": "#8a3a6a",
    "ambient": "#777777", "none": "#222222",
}  # fmt: skip
OTHER = "#a05195"
DOMINATED = "#c4c4c4"

HEIGHT = 460  # px
LEFT, RIGHT, TOP, BOTTOM = 66, 540, 56, 404
FREE, CLEAR = 0.5, 30  # decades left of the smallest cost, where what costs nothing stands; px without ticks there


def shapes(study: dict, cost: str) -> list[NamedTuple]:
    """What a plot of 1 - SSIM of B against `cost` is made of, from back to front; `study` is as `tables` makes it."""
    entries, shown = study["entries"], compared(study["entries"], cost)
    costs = [entries[i][cost] for i in shown]
    limit = error_of(study["ceiling"])
    errors = [limit, *(error_of(entries[i]["mean"]["ssim"]) for i in shown)]
    paid = [value for value in costs if value > 0] or [1.0]
    free = any(value <= 0 for value in costs)
    low = math.log10(min(paid)) - (FREE if free else 0.08)
    x = Axis(low, max(math.log10(max(paid)) + 0.08, low + 0.5), LEFT, RIGHT)
    y = Axis(math.log10(min(errors)) - 0.1, math.log10(max(errors)) + 0.05, BOTTOM, TOP)
    at = {
        i: (LEFT + 8 if value <= 0 else x.at(value), y.at(error))
        for i, value, error in zip(shown, costs, errors[1:], strict=True)
    }
    title = f"Error of indirect light against {COSTS[cost]}"
    found = [*grid(x, y, limit, title, "; grey: dominated", COSTS[cost], free)]
    series: dict[tuple, list[int]] = {}
    for i in shown:
        series.setdefault((entries[i]["method"], entries[i]["scale"]), []).append(i)
    for (method, scale), mine in series.items():
        for line in swept(study, mine):
            found.append(Line(tuple(at[i] for i in line), colour_of(method), 1.0 if scale == 1 else 0.5))
    for i in sorted(shown, key=lambda i: not entries[i]["dominated"][cost]):
        grey = entries[i]["dominated"][cost]
        found.append(Dot(at[i], DOMINATED if grey else colour_of(entries[i]["method"]), i))
    return [*found, *_legend(study)]


def error_of(ssim: float) -> float:
    """1 - SSIM, above 0 for logarithms."""
    return max(1 - ssim, 1e-5)


def swept(study: dict, places: Sequence[int]) -> list[list[int]]:
    """The places of entries of one method and resolution as lines: over its setting, and over the number of paths."""
    entries = study["entries"]
    by_value = sorted((i for i in places if entries[i]["paths"] == 1), key=lambda i: entries[i]["value"])
    budgets = {entries[i]["value"] for i in places if entries[i]["paths"] != 1}
    by_paths = sorted((i for i in places if entries[i]["value"] in budgets), key=lambda i: entries[i]["paths"])
    return [line for line in (by_value, by_paths) if len(line) > 1]


def colour_of(method: str) -> str:
    """Colour of a method's points."""
    return COLOURS.get(method, OTHER)


def grid(x: Axis, y: Axis, limit: float, title: str, more: str, label: str, free: bool = False) -> Iterator[NamedTuple]:
    """The band below the error `limit`, a title with `more` in its second line, ticks, and the label of the x axis.

    `free`: whether some costs are 0.
    """
    left, right, bottom, top = x.first, x.last, y.first, y.last
    yield Box((left, y.at(limit)), (right, bottom), BAND)
    yield Text((left, top - 32), title, INK, size=16)
    yield Text((left, top - 13), f"1 - SSIM of B in views that were not fitted, both axes logarithmic{more}", GREY)
    for value in y.ticks():
        yield Line(((left, y.at(value)), (right, y.at(value))), RULE)
        yield Text((left - 6, y.at(value) + 4), f"{value:g}", GREY, "end", 11)
    for value in (value for value in x.ticks() if not free or x.at(value) > left + CLEAR):
        yield Line(((x.at(value), top), (x.at(value), bottom)), RULE)
        yield Text((x.at(value), bottom + 16), short(value), GREY, "middle", 11)
    if free:
        yield Text((left + 8, bottom + 16), "0", GREY, "middle", 11)
    yield Text((left + 6, bottom - 5), "within the noise of the reference", GREY, size=10)
    yield Text(((left + right) / 2, bottom + 38), label, INK, "middle")


def _legend(study: dict) -> Iterator[NamedTuple]:
    for row, method in enumerate(study["methods"]):
        at = TOP + 10 + 24 * row
        yield Box((RIGHT + 18, at - 9), (RIGHT + 28, at + 1), colour_of(method["name"]))
        yield Text((RIGHT + 34, at), method["title"], INK)
