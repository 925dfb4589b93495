"""An SVG plot of accuracy against cost: held-out SSIM by the number of Gaussians, one line per scene."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gsgi.runtime.file import codec

# After Okabe and Ito (2008): distinguishable with any colour vision, and dark enough for thin lines on white.
COLOURS = "#0072b2", "#d55e00", "#008a64", "#a8508a"
INK, GREY, RULE = "#222222", "#6b6b6b", "#e4e4e4"

WIDTH, HEIGHT = 720, 420  # px
LEFT, RIGHT, TOP, BOTTOM = 54, 562, 74, 350  # px, edges of the plot; the names of the lines are to its right
LABEL = 36  # px, least distance between two names


class Curve(NamedTuple):
    """A scene: (Gaussians, SSIM) of its fits, and the ceiling that the noise of the reference sets."""

    name: str
    points: list[tuple[int, float]]
    ceiling: float


class _Axes(NamedTuple):
    """The range of both axes: log2 of the number of Gaussians, and SSIM up to 1."""

    low: float
    high: float
    bottom: float
    step: float

    @staticmethod
    def of(curves: list[Curve]) -> "_Axes":
        counts, ssims = zip(*(point for curve in curves for point in curve.points), strict=True)
        low, high = np.log2(max(min(counts), 1)), np.log2(max(counts))
        least = min(*ssims, *(curve.ceiling for curve in curves))
        step = next(step for step in (0.01, 0.02, 0.05, 0.1, 0.2) if 1 - least < 6 * step or step == 0.2)
        return _Axes(low - 0.15, high + 0.15, np.floor(least / step) * step, step)

    def x(self, count: float) -> float:
        return LEFT + (np.log2(max(count, 1)) - self.low) / (self.high - self.low) * (RIGHT - LEFT)

    def y(self, ssim: float) -> float:
        return BOTTOM - (ssim - self.bottom) / (1 - self.bottom) * (BOTTOM - TOP)


def draw(curves: list[Curve]) -> str:
    """The plot, WIDTH x HEIGHT px. At least one curve must have two different numbers of Gaussians."""
    axes = _Axes.of(curves)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'font-family="Inter, Helvetica, Arial, sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        _text(LEFT, 28, "Accuracy against cost", INK, size=17, weight=600),
        _text(LEFT, 48, "SSIM of indirect light in views that were not fitted; dashed: the ceiling that noise of the "
              "reference sets", GREY),
        *_grid(axes),
    ]  # fmt: skip
    heights = _spread([axes.y(curve.points[-1][1]) for curve in curves])
    for i, curve in enumerate(curves):
        parts += _line(curve, axes, COLOURS[i % len(COLOURS)], heights[i])
    return "\n".join([*parts, "</svg>", ""])


def _grid(axes: _Axes) -> Iterator[str]:
    for ssim in np.arange(axes.bottom, 1 + axes.step / 2, axes.step):
        y = axes.y(ssim)
        yield f'<path d="M{LEFT} {y:.1f}H{RIGHT}" stroke="{RULE}"/>'
        yield _text(LEFT - 8, y + 4, f"{ssim:.2f}", GREY, anchor="end")
    for power in range(int(np.ceil(axes.low)), int(np.floor(axes.high)) + 1):
        x = axes.x(2**power)
        yield f'<path d="M{x:.1f} {BOTTOM}v5" stroke="{GREY}"/>'
        yield _text(x, BOTTOM + 20, f"{2**power:,}".replace(",", "\u202f"), INK, anchor="middle")
        yield _text(x, BOTTOM + 36, _kilobytes(2**power), GREY, anchor="middle")
    yield f'<path d="M{LEFT} {BOTTOM}H{RIGHT}" stroke="{GREY}"/>'
    yield _text(RIGHT + 24, BOTTOM + 20, "Gaussians", INK)
    yield _text(RIGHT + 24, BOTTOM + 36, "kB in the file", GREY)


def _line(curve: Curve, axes: _Axes, colour: str, label: float) -> Iterator[str]:
    """Yield the line, its ceiling, and its name beside its end, at height `label`."""
    points = [(axes.x(count), axes.y(ssim)) for count, ssim in curve.points]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ceiling = axes.y(curve.ceiling)
    yield (
        f'<path d="M{LEFT} {ceiling:.1f}H{RIGHT}" stroke="{colour}" stroke-dasharray="5 4" stroke-opacity="0.6"/>'
        f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2" stroke-linejoin="round"/>'
    )
    yield from (f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in points)
    x, y = points[-1]
    yield f'<path d="M{x + 5:.1f} {y:.1f}L{RIGHT + 19} {label:.1f}" stroke="{colour}" stroke-opacity="0.4"/>'
    yield _text(RIGHT + 24, label + 1, curve.name, colour, weight=600)
    yield _text(RIGHT + 24, label + 15, f"{curve.points[-1][1]:.3f} of {curve.ceiling:.3f}", GREY, size=11)


def _spread(heights: list[float]) -> list[float]:
    """The heights, moved just far enough to be LABEL apart and above the labels of the axis."""
    order = sorted(range(len(heights)), key=heights.__getitem__)
    moved = dict(enumerate(heights))
    for above, below in pairwise(order):
        moved[below] = max(moved[below], moved[above] + LABEL)
    limit = BOTTOM - LABEL / 2
    for i in reversed(order):
        moved[i] = min(moved[i], limit)
        limit = moved[i] - LABEL
    return [moved[i] for i in range(len(heights))]


def _kilobytes(count: int) -> str:
    size = codec.file_bytes(count, 0) / 1000
    return f"{size:.1f}" if size < 10 else f"{size:.0f}"


def _text(x: float, y: float, text: str, colour: str, anchor: str = "start", size: int = 12, weight: int = 400) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}" font-size="{size}" '
        f'font-weight="{weight}">{text}</text>'
    )
