"""A level of a .gsgi file: streams of integers, and the header record that says what their steps are."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from gsgi.runtime.gaussians import BASES, Gaussians

from .bands import SH_CODE_MAX
from .codes import (
    FLOOR_MAX,
    FLOOR_MIN,
    POSITION_BITS,
    SCALE_OCTAVES,
    SLOPE_CODE_MAX,
    Codes,
    angle_bits,
    dequantise,
    exponents,
    light_of,
    quantise,
)
from .colours import code_max
from .integers import least_bytes, read_bits, read_integers, write_bits, write_integers
from .order import spatial_order

LEVEL = np.dtype(
    [
        ("gaussian_count", "<u4"),
        ("sh_degree", "u1"),
        ("basis", "u1"),
        ("position_floor", "<i2"),
        ("position_bits", "u1"),
        ("scale_steps", "u1"),
        ("normal_steps", "u1"),
        ("angle_bits", "u1"),
        ("opacity_steps", "u1"),
        ("light_steps", "u1"),
        ("sh_steps", "u1"),
        ("slope_steps", "u1"),
    ]
)
STEPS = "scale_steps", "normal_steps", "opacity_steps", "light_steps", "sh_steps", "slope_steps"
BITS_MAX = 16  # of position_bits and angle_bits

# What the encoder chooses, by measurement (docs/benchmarks.md): bits for an attribute until a further one gains as much
# elsewhere. Shapes take few, since a fit solves for light on rounded ones. Through `over` light passes many Gaussians,
# opaque ones among them, whose errors add up.
FINE_STEPS = {
    "position_bits": 3, "scale_steps": 12, "normal_steps": 96, "angle_bits": 2, "opacity_steps": 24,
    "light_steps": 32, "sh_steps": 24, "slope_steps": 64,
}  # fmt: skip
COARSE_STEPS = {
    "position_bits": 3, "scale_steps": 20, "normal_steps": 80, "angle_bits": 2, "opacity_steps": 16,
    "light_steps": 16, "sh_steps": 18, "slope_steps": 36,
}  # fmt: skip
OVER_STEPS = COARSE_STEPS | {
    "position_bits": 5, "scale_steps": 32, "normal_steps": 112, "opacity_steps": 255, "light_steps": 48, "sh_steps": 48,
}  # fmt: skip

DIFFERENCES = "scale_long", "scale_middle", "scale_normal", "normal_u", "normal_v", "opacity", "green", "red", "blue"

# expect(condition, byte, field, expected) raises if the condition is false
Expect = Callable[[bool, int, str, str], None]


def stream_counts(level: np.ndarray) -> dict[str, int]:
    """The streams of a LEVEL record by name, in their order, and how many integers each holds."""
    count = int(level["gaussian_count"])
    names = "scale_long", "scale_middle", "scale_normal", "normal_u", "normal_v"
    names += "position_x", "position_y", "position_z", "opacity"
    return dict.fromkeys(names, count) | light_counts(level)


def light_counts(level: np.ndarray, of_group: bool = False) -> dict[str, int]:
    """Those of the streams that hold light, of the level or of a light group on it; all others hold shapes."""
    count = int(level["gaussian_count"])
    counts = dict.fromkeys(("green", "red", "blue"), count)
    for band in range(1, int(level["sh_degree"]) + 1):
        counts[f"sh{band}_green"] = (2 * band + 1) * count
        if not (of_group and band > 1):
            counts[f"sh{band}_red_blue"] = 2 * (2 * band + 1) * count
    return counts | ({"slope": 2 * count} if BASES[level["basis"]] == "linear" else {})


def least_level_bytes(level: np.ndarray) -> int:
    """The fewest bytes that the streams of a LEVEL record can take, computed without allocating anything."""
    return sum(map(least_bytes, stream_counts(level).values()))


def encode_level(
    gaussians: Gaussians, level: np.ndarray, steps: dict[str, int], facing: bool
) -> tuple[bytes, np.ndarray]:
    """The streams of a level as bytes, and the order (N,) in which they hold the Gaussians.

    Fills in `level`, a LEVEL record, with `steps` among others. `facing`: the z axis has a meaning of its own, and must
    remain.
    """
    for name in ("position", "rotation", "scale", "opacity", "sh", "slope", "relief"):
        array = getattr(gaussians, name)
        finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
        assert finite.all(), f"Gaussian {finite.argmin()}: {name} is not finite"
    level["gaussian_count"], level["sh_degree"] = len(gaussians), gaussians.sh_degree
    level["basis"] = BASES.index(gaussians.basis)
    for name, value in steps.items():
        level[name] = value
    codes = quantise(gaussians, level, facing)
    order = storage_order(codes, level)
    codes = codes[order]
    streams = {name: write_integers(value, name in DIFFERENCES) for name, value in _shape(codes, level).items()}
    streams["normal_v"] += write_bits(codes.angle, angle_bits(codes.scale, level))
    return b"".join(streams.values()) + encode_light(codes, level), order


def encode_light(codes: Codes, level: np.ndarray, of_group: bool = False) -> bytes:
    """The streams of the light of a level whose LEVEL record is filled in, or `of_group`: of a light group on it.

    `codes` are in the order of storage.
    """
    values = _light(codes, level)
    return b"".join(write_integers(values[name], name in DIFFERENCES) for name in light_counts(level, of_group))


def decode_level(level: np.ndarray, data: bytes, at: int, end: int, name: str, expect: Expect) -> Gaussians:
    """The Gaussians whose streams take the bytes `at` to `end` of `data`; `level` is their LEVEL record, checked.

    Fields in messages are called `name.stream`.
    """
    return dequantise(_Reader(level, data, at, end, name, expect).codes(), level)


def decode_group_light(
    level: np.ndarray, data: bytes, at: int, end: int, name: str, expect: Expect
) -> tuple[np.ndarray, np.ndarray, int]:
    """sh (N, K, 3) and slope (N, 0 or 2), float32, of a light group, from byte `at` on, and the byte after them."""
    reader = _Reader(level, data, at, end, name, expect)
    reader.counts = light_counts(level, of_group=True)
    return *light_of(*reader.light(), level, of_group=True), reader.at


def check_level(level: np.ndarray, name: str, expect: Callable) -> None:
    """Refuse a LEVEL record, called `name`, whose numbers would not decode to finite, usable Gaussians.

    `expect(condition, field, expected, got)` raises if the condition is false.
    """
    floor = level["position_floor"]
    in_range = FLOOR_MIN <= floor <= FLOOR_MAX
    expect(in_range, f"{name}.position_floor", f"{FLOOR_MIN} to {FLOOR_MAX}", floor)
    for field in ("position_bits", "angle_bits"):
        expect(level[field] <= BITS_MAX, f"{name}.{field}", f"at most {BITS_MAX}", level[field])
    for field in STEPS:
        expect(level[field] > 0, f"{name}.{field}", "at least 1", level[field])


def storage_order(codes: Codes, level: np.ndarray) -> np.ndarray:
    """The order (N,) in which Gaussians are stored: by rising exponent, then beside similar ones."""
    features = codes.position, codes.normal, codes.scale, 2 * codes.light[:, 1:2], codes.opacity[:, None]
    steps = int(level["normal_steps"])
    kind = (3 * np.rint(codes.normal[:, 0] / steps) + np.rint(codes.normal[:, 1] / steps)).astype(np.int8)
    return spatial_order(exponents(codes.scale, level), codes.position, kind, features)


def _shape(codes: Codes, level: np.ndarray) -> dict[str, np.ndarray]:
    """What the streams of the shapes hold, by name: integers (N,)."""
    values = {"scale_long": codes.scale[:, 0]}
    values |= {
        "scale_middle": codes.scale[:, 0] - codes.scale[:, 1],
        "scale_normal": codes.scale[:, 0] - codes.scale[:, 2],
    }
    values |= {"normal_u": codes.normal[:, 0], "normal_v": codes.normal[:, 1]}
    exponent = exponents(codes.scale, level)
    rise = np.diff(exponent, prepend=exponent[:1])[:, None]
    before = np.concatenate([np.zeros((1, 3), np.int32), codes.position[:-1]])[: len(codes)] >> np.minimum(rise, 31)
    values |= dict(zip(("position_x", "position_y", "position_z"), (codes.position - before).T, strict=True))
    return values | {"opacity": codes.opacity}


def _light(codes: Codes, level: np.ndarray) -> dict[str, np.ndarray]:
    """What the streams of the light hold, by name: integers (N,), or more of them, Gaussian by Gaussian."""
    red, green, blue = codes.light.T
    values = {"green": green, "red": red - green, "blue": blue - green, "slope": codes.slope.ravel()}
    for band in range(1, int(level["sh_degree"]) + 1):
        part = codes.sh[:, band * band - 1 : (band + 1) ** 2 - 1]
        green = part[:, :, 1:2]
        values |= {f"sh{band}_green": green.ravel(), f"sh{band}_red_blue": (part[:, :, ::2] - green).ravel()}
    return values


class _Reader:
    """Reads the streams of a level one after the other, and refuses those that the encoder never writes."""

    def __init__(self, level: np.ndarray, data: bytes, at: int, end: int, name: str, expect: Expect):
        self.level, self.data, self.at, self.end, self.name, self.expect = level, data, at, end, name, expect
        self.counts = stream_counts(level)

    def codes(self) -> Codes:
        """All codes of the level."""
        level, octaves = self.level, SCALE_OCTAVES * int(self.level["scale_steps"])
        scales = f"scales within 2^+-{SCALE_OCTAVES} m"
        first = self._stream("scale_long")
        self._within(first, -octaves, octaves, scales)
        second = self._stream("scale_middle")
        self._within(second, 0, None, "a second axis no longer than the first")
        second = first - second
        self._within(second, -octaves, octaves, scales)
        third = first - self._stream("scale_normal")
        self._within(third, -octaves, octaves, scales)
        scale = np.stack([first, second, third], axis=1)
        exponent = exponents(scale, level)
        self._within(np.diff(exponent), 0, None, "positions in steps that do not shrink")
        steps = int(level["normal_steps"])
        normal = np.stack(
            [self._in_steps("normal_u", -steps, steps), self._in_steps("normal_v", -steps, steps)], axis=1
        )
        angle, self.at = read_bits(self.data, self.at, self.end, angle_bits(scale, level), self._expect_in("angle"))
        angle = angle.astype(np.int32)
        position = np.stack([self._position(f"position_{axis}", exponent) for axis in "xyz"], axis=1)
        opacity = self._in_steps("opacity", 0, int(level["opacity_steps"]))
        light, sh, slope = self.light()
        self.expect(self.at == self.end, self.at, self.name, "the end of the section")
        return Codes(scale, normal, angle, position, opacity, light, sh, slope)

    def light(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The codes of the light: `light`, `sh` and `slope` of Codes."""
        channels, bands = self._channels(), self._bands()
        slope = np.zeros((int(self.level["gaussian_count"]), 0), np.int32)
        if "slope" in self.counts:
            slope = self._in_steps("slope", -SLOPE_CODE_MAX, SLOPE_CODE_MAX).reshape(-1, 2)
        return channels, bands, slope

    def _stream(self, stream: str) -> np.ndarray:
        self.stream, self.start = stream, self.at
        values, self.at = read_integers(self.data, self.at, self.end, self.counts[stream], self._expect_in(stream))
        return values.astype(np.int32)

    def _expect_in(self, stream: str) -> Callable:
        return lambda condition, byte, expected: self.expect(condition, byte, f"{self.name}.{stream}", expected)

    def _within(self, values: np.ndarray, low: int | None, high: int | None, expected: str) -> None:
        fine = (low is None or values.min(initial=low) >= low) and (high is None or values.max(initial=high) <= high)
        self.expect(bool(fine), self.start, f"{self.name}.{self.stream}", expected)

    def _in_steps(self, stream: str, low: int, high: int) -> np.ndarray:
        values = self._stream(stream)
        self._within(values, low, high, f"steps from {low} to {high}")
        return values

    def _position(self, stream: str, exponent: np.ndarray) -> np.ndarray:
        """Coordinates (N,): each is stored as the difference to the one before it, in its own steps, rounded down."""
        values = self._stream(stream).astype(np.int64)
        before = 0
        runs = np.flatnonzero(np.diff(exponent, prepend=exponent[:1] - 1))
        for low, high in pairwise([*runs, len(values)]):
            if low:
                before = int(values[low - 1]) >> int(exponent[low] - exponent[low - 1])
            values[low] += before
            values[low:high] = np.cumsum(values[low:high])
        most = (1 << POSITION_BITS) - 1
        self._within(values, -most, most, f"steps from {-most} to {most}")
        return values.astype(np.int32)

    def _channels(self) -> np.ndarray:
        most = code_max(int(self.level["light_steps"]))
        green = self._in_steps("green", 0, most)
        channels = [green]
        for name in ("red", "blue"):
            channels.append(green + self._stream(name))
            self._within(channels[-1], 0, most, f"steps from 0 to {most}")
        return np.stack([channels[1], green, channels[2]], axis=1)

    def _bands(self) -> np.ndarray:
        bands = []
        for band in range(1, int(self.level["sh_degree"]) + 1):
            size = 2 * band + 1
            green = self._in_steps(f"sh{band}_green", -SH_CODE_MAX, SH_CODE_MAX).reshape(-1, size)
            others = np.repeat(green[:, :, None], 2, axis=2)
            if f"sh{band}_red_blue" in self.counts:
                others += self._stream(f"sh{band}_red_blue").reshape(-1, size, 2)
            self._within(others, -SH_CODE_MAX, SH_CODE_MAX, f"steps from {-SH_CODE_MAX} to {SH_CODE_MAX}")
            bands.append(np.stack([others[:, :, 0], green, others[:, :, 1]], axis=2))
        count = int(self.level["gaussian_count"])
        return np.concatenate([np.zeros((count, 0, 3), np.int32), *bands], axis=1)
