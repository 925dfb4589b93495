"""Plots as lists of lines, boxes, dots and words, and those as SVG and as PNG."""

import io
import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

INK, GREY, RULE, BAND = "#222222", "#6b6b6b", "#e4e4e4", "#f3efe2"
WIDTH = 760  # px
RADIUS = 4.5


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


class Axis(NamedTuple):
    """A logarithmic axis from `low` to `high` (log10) between two pixels."""

    low: float
    high: float
    first: float
    last: float

    def at(self, value: float) -> float:
        """The pixel of a value above 0."""
        share = (math.log10(value) - self.low) / (self.high - self.low)
        return self.first + share * (self.last - self.first)

    def ticks(self) -> list[float]:
        """The values at which it is labelled."""
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        span = self.high - self.low
        steps = (1,) if span > 3 else (1, 2, 5) if span > 0.8 else (1, 1.5, 2, 3, 4, 5, 7)
        values = [step * 10.0**decade for decade in decades for step in steps]
        return [value for value in values if self.low <= math.log10(value) <= self.high]


def svg(parts: Sequence[NamedTuple], height: int) -> str:
    """The parts as an SVG image of WIDTH x `height` px. A dot has the class `dot` and its entry as `data-entry`."""
    body = "\n".join(_svg(part) for part in parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        'font-family="Inter, Helvetica, Arial, sans-serif">\n'
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


def png(parts: Sequence[NamedTuple], height: int, zoom: int = 2) -> bytes:
    """The same as a PNG image with `zoom` pixels along each unit."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGB", (zoom * WIDTH, zoom * height), "white")
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
        f"{escape(part.text)}</text>"
    )


def short(value: float) -> str:
    """A number in few characters."""
    for size, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g} {unit}"
    return f"{value:g}"
