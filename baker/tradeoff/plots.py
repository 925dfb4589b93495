"""Log-log plots of error against cost, as SVG and as PNG."""

import io
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from .ranking import COSTS

# After Okabe and Ito (2008): distinguishable with any colour vision, and dark enough on white.
COLOURS = {
    "surface": "#d55e00", "over": "#e69f00", "lightmap": "#56b4e9", "lightmap-denoised": "#0072b2",
    "probes": "#66c2a5", "probes-visibility": "#008a64", "radiosity": "#b5a300", "light-volume": "#8c564b",
    "voxel-cones": "#b2182b", "path-tracing": "#cc79a7", "path-tracing-denoised": "#8a3a6a",
    "ambient": "#777777", "none": "#222222",
}  # fmt: skip
OTHER = "#a05195"
INK, GREY, RULE, BAND, DOMINATED = "#222222", "#6b6b6b", "#e4e4e4", "#f3efe2", "#c4c4c4"

WIDTH, HEIGHT = 760, 460  # px
LEFT, RIGHT, TOP, BOTTOM = 66, 540, 56, 404
RADIUS = 4.5
FREE, CLEAR = 0.5, 30  # decades left of the smallest cost, where what costs nothing stands; px without ticks there


class Line(NamedTuple):
    """A line through points (x, y), px."""

    points: tuple[tuple[float, float], ...]
    colour: str
    width: float = 1.0


class Box(NamedTuple):
    """A filled rectangle from one corner to the other, px."""

    low: tuple[float, float]
    high: tuple[float, float]
    colour: str


class Dot(NamedTuple):
    """A filled circle; `entry` is the index of what it stands for."""

    at: tuple[float, float]
    colour: str
    entry: int


class Text(NamedTuple):
    """A line of text, whose `anchor` is "start", "middle" or "end", px."""

    at: tuple[float, float]
    text: str
    colour: str
    anchor: str = "start"
    size: int = 12


class _Axis(NamedTuple):
    """A logarithmic axis from `low` to `high` (log10) between two pixels."""

    low: float
    high: float
    first: float
    last: float

    def at(self, value: float) -> float:
        share = (math.log10(value) - self.low) / (self.high - self.low)
        return self.first + share * (self.last - self.first)

    def ticks(self) -> list[float]:
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        span = self.high - self.low
        steps = (1,) if span > 3 else (1, 2, 5) if span > 0.8 else (1, 1.5, 2, 3, 4, 5, 7)
        values = [step * 10.0**decade for decade in decades for step in steps]
        return [value for value in values if self.low <= math.log10(value) <= self.high]


def shapes(study: dict, cost: str) -> list[NamedTuple]:
    """What a plot of 1 - SSIM of B against `cost` is made of, from back to front; `study` is as `tables` makes it."""
    entries = study["entries"]
    costs = [entry[cost] for entry in entries]
    errors = [max(1 - entry["mean"]["ssim"], 1e-5) for entry in entries]
    limit = max(1 - study["ceiling"], 1e-5)
    paid = [value for value in costs if value > 0] or [1.0]
    free = any(value <= 0 for value in costs)
    low = math.log10(min(paid)) - (FREE if free else 0.08)
    x = _Axis(low, max(math.log10(max(paid)) + 0.08, low + 0.5), LEFT, RIGHT)
    y = _Axis(math.log10(min(*errors, limit)) - 0.1, math.log10(max(errors)) + 0.05, BOTTOM, TOP)
    places = [
        (LEFT + 8 if value <= 0 else x.at(value), y.at(error)) for value, error in zip(costs, errors, strict=True)
    ]
    found = [
        Box((LEFT, y.at(limit)), (RIGHT, BOTTOM), BAND),
        Text((LEFT + 6, BOTTOM - 5), "within the noise of the reference", GREY, size=10),
        *_grid(x, y, cost, free),
    ]
    series = list(dict.fromkeys((entry["method"], entry["scale"]) for entry in entries))
    for method, scale in series:
        mine = [i for i, entry in enumerate(entries) if (entry["method"], entry["scale"]) == (method, scale)]
        mine.sort(key=lambda i: entries[i]["value"])
        if len(mine) > 1:
            found.append(Line(tuple(places[i] for i in mine), colour_of(method), 1.0 if scale == 1 else 0.5))
    order = sorted(range(len(entries)), key=lambda i: not entries[i]["dominated"][cost])
    for i in order:
        grey = entries[i]["dominated"][cost]
        found.append(Dot(places[i], DOMINATED if grey else colour_of(entries[i]["method"]), i))
    return [*found, *_legend(study)]


def colour_of(method: str) -> str:
    """Colour of a method's points."""
    return COLOURS.get(method, OTHER)


def svg(parts: Sequence[NamedTuple]) -> str:
    """The parts as an SVG image. A dot has the class `dot` and its entry as `data-entry`."""
    body = "\n".join(_svg(part) for part in parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'font-family="Inter, Helvetica, Arial, sans-serif">\n'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


def png(parts: Sequence[NamedTuple], zoom: int = 2) -> bytes:
    """The parts as a PNG image with `zoom` pixels along each unit."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGB", (zoom * WIDTH, zoom * HEIGHT), "white")
    draw = ImageDraw.Draw(image)

    def px(at: tuple[float, float]) -> tuple[float, float]:
        return zoom * at[0], zoom * at[1]

    for part in parts:
        if isinstance(part, Line):
            draw.line([px(at) for at in part.points], part.colour, max(round(zoom * part.width), 1))
        elif isinstance(part, Box):
            (left, top), (right, bottom) = part.low, part.high
            draw.rectangle((*px((left, min(top, bottom))), *px((right, max(top, bottom)))), part.colour)
        elif isinstance(part, Dot):
            draw.circle(px(part.at), zoom * RADIUS, part.colour, "white")
        else:
            anchor = {"start": "ls", "middle": "ms", "end": "rs"}[part.anchor]
            draw.text(px(part.at), part.text, part.colour, ImageFont.load_default(zoom * part.size), anchor)
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


def _svg(part: NamedTuple) -> str:
    if isinstance(part, Line):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in part.points)
        return f'<polyline points="{points}" fill="none" stroke="{part.colour}" stroke-width="{part.width}"/>'
    if isinstance(part, Box):
        (left, top), (right, bottom) = part.low, part.high
        top, bottom = min(top, bottom), max(top, bottom)
        return (
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" '
            f'fill="{part.colour}"/>'
        )
    if isinstance(part, Dot):
        (x, y) = part.at
        return (
            f'<circle class="dot" data-entry="{part.entry}" cx="{x:.1f}" cy="{y:.1f}" r="{RADIUS}" '
            f'fill="{part.colour}" stroke="#ffffff"/>'
        )
    x, y = part.at
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{part.colour}" text-anchor="{part.anchor}" font-size="{part.size}">'
        f"{part.text}</text>"
    )


def _grid(x: _Axis, y: _Axis, cost: str, free: bool) -> Iterator[NamedTuple]:
    yield Text((LEFT, 24), f"Error of indirect light against {COSTS[cost]}", INK, size=16)
    yield Text((LEFT, 43), "1 - SSIM of B in views that were not fitted, both axes logarithmic; grey: dominated", GREY)
    for value in y.ticks():
        yield Line(((LEFT, y.at(value)), (RIGHT, y.at(value))), RULE)
        yield Text((LEFT - 6, y.at(value) + 4), f"{value:g}", GREY, "end", 11)
    for value in (value for value in x.ticks() if not free or x.at(value) > LEFT + CLEAR):
        yield Line(((x.at(value), TOP), (x.at(value), BOTTOM)), RULE)
        yield Text((x.at(value), BOTTOM + 16), _short(value), GREY, "middle", 11)
    if free:
        yield Text((LEFT + 8, BOTTOM + 16), "0", GREY, "middle", 11)
    yield Text(((LEFT + RIGHT) / 2, BOTTOM + 38), COSTS[cost], INK, "middle")


def _legend(study: dict) -> Iterator[NamedTuple]:
    for row, method in enumerate(study["methods"]):
        at = TOP + 10 + 24 * row
        yield Box((RIGHT + 18, at - 9), (RIGHT + 28, at + 1), colour_of(method["name"]))
        yield Text((RIGHT + 34, at), method["title"], INK)


def _short(value: float) -> str:
    for size, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g} {unit}"
    return f"{value:g}"
