"""Gaussians of a .gsgi file as integers: how many steps of its own size, or of its light, each number has."""

from dataclasses import dataclass, fields

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians

from .bands import pack_bands, pack_group_bands
from .colours import pack_light, powers, unpack_light
from .rotations import axes, pack_normal, rotation_of, unpack_normal

SCALE_OCTAVES = 57  # scales within 2^+-57 m keep their variances in float32
THIN = 4  # octaves; a position is as exact as the shortest axis needs, but none counts as shorter by more
POSITION_BITS = 24  # of a coordinate, which float32 holds exactly
FLOOR_MIN, FLOOR_MAX = -149, 104  # powers of two, 2^24 times which is within float32
SLOPE_CODE_MAX = 127
AT_ONCE = 1 << 16  # Gaussians whose numbers are computed together, since that takes many times their own memory


@dataclass(frozen=True)
class Codes:
    """N Gaussians as int32; FORMAT.md says what each number means.

    scale     (N, 3): the logarithms of the standard deviations, the first one no smaller than the second
    normal    (N, 2): the z axis on an octahedron
    angle     (N,): the turn about it, in 2^angle_bits steps of half a turn
    position  (N, 3): multiples of 2^exponents m
    opacity   (N,): its square root
    light     (N, 3): the logarithms of the constant SH band
    sh        (N, K - 1, 3): the other bands, relative to the brightest channel of the constant one; in a light group
              relative to the same channel of it, and from band 2 on equal in all channels
    slope     (N, 0 or 2)
    """

    scale: np.ndarray
    normal: np.ndarray
    angle: np.ndarray
    position: np.ndarray
    opacity: np.ndarray
    light: np.ndarray
    sh: np.ndarray
    slope: np.ndarray

    def __len__(self) -> int:
        return len(self.opacity)

    def __getitem__(self, which) -> "Codes":
        return Codes(*(getattr(self, field.name)[which] for field in fields(self)))


def angle_bits(scale: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Bits (N,) of the angle: one more where the first two axes differ by twice as much, none where they are alike."""
    difference = scale[:, 0] - scale[:, 1]
    bits = np.frexp(difference.astype(np.float64))[1] + int(level["angle_bits"])
    return np.where(difference > 0, bits, 0).astype(np.int32)


def exponents(scale: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Powers of two (N,), m, of which positions are multiples: less than the shortest axis by `position_bits`."""
    steps = int(level["scale_steps"])
    shortest = np.maximum(scale[:, 1:].min(axis=1), scale[:, 0] - THIN * steps)
    return np.maximum(shortest // steps - int(level["position_bits"]), int(level["position_floor"]))


def quantise(gaussians: Gaussians, level: np.ndarray, facing: bool, of_group: bool = False) -> Codes:
    """Round each number to a code near it, and set the `position_floor` of `level`, a LEVEL record.

    The axes of a Gaussian are renamed so that the first is no shorter than the second. With `facing` the z axis has a
    meaning of its own and stays; without, and without slopes, it becomes the one whose length is most unlike theirs.
    `of_group` says that the light is that of a light group.
    """
    parts = [_shape_and_light(part, level, facing, of_group) for part in _parts(gaussians)]
    codes = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    scale = codes["scale"]
    level["position_floor"] = _position_floor(gaussians.position, scale, level)
    position = np.empty((len(scale), 3), np.int32)
    for part in _slices(len(scale)):
        step = np.ldexp(1.0, exponents(scale[part], level))
        position[part] = np.rint(gaussians.position[part] / step[:, None])
    return Codes(**codes, position=position)


def dequantise(codes: Codes, level: np.ndarray) -> Gaussians:
    """The Gaussians of codes that a reader accepts, bitwise the same in every language."""
    parts = [_dequantised(codes[part], level) for part in _slices(len(codes))]
    names = Gaussians.__annotations__
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return Gaussians(*map(np.ascontiguousarray, columns))


def _dequantised(codes: Codes, level: np.ndarray) -> Gaussians:
    bits = angle_bits(codes.scale, level)
    turn = np.ldexp(codes.angle * np.pi, -bits)
    step = np.ldexp(np.float32(1), exponents(codes.scale, level))
    sh, slope = light_of(codes.light, codes.sh, codes.slope, level)
    return Gaussians(
        position=codes.position.astype(np.float32) * step[:, None],
        rotation=rotation_of(unpack_normal(codes.normal, int(level["normal_steps"])), turn).astype(np.float32),
        scale=powers(codes.scale, int(level["scale_steps"])).astype(np.float32),
        opacity=(codes.opacity.astype(np.float32) / np.float32(level["opacity_steps"])) ** 2,
        sh=sh,
        slope=slope,
    )


def light_of(
    light: np.ndarray, sh: np.ndarray, slope: np.ndarray, level: np.ndarray, of_group: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """sh (N, K, 3) and slope (N, 0 or 2), float32, of the codes of these names."""
    dc = _sh_dc(light, level)
    unit = dc if of_group else dc.max(axis=1, keepdims=True)
    rest = sh.astype(np.float32) / np.float32(level["sh_steps"]) * unit[:, None]
    return np.concatenate([dc[:, None], rest], axis=1), slope.astype(np.float32) / np.float32(level["slope_steps"])


def _shape_and_light(gaussians: Gaussians, level: np.ndarray, facing: bool, of_group: bool) -> dict[str, np.ndarray]:
    """All codes but those of the positions."""
    frame, slope = axes(gaussians.rotation), gaussians.slope.astype(np.float64)
    length = np.log2(np.clip(gaussians.scale.astype(np.float64), 2.0**-SCALE_OCTAVES, 2.0**SCALE_OCTAVES))
    scale = _rounded(length * int(level["scale_steps"]))
    free = not facing and not gaussians.sloped
    if free:
        frame, scale = _with_odd_axis_last(frame, scale)
    swapped = scale[:, 1] > scale[:, 0]
    frame[swapped] = np.stack([frame[swapped, :, 1], -frame[swapped, :, 0], frame[swapped, :, 2]], axis=2)
    scale[swapped, :2] = scale[swapped, 1::-1]
    if gaussians.sloped:
        slope[swapped] = slope[swapped, ::-1] * [1, -1]
    if free:
        frame[(scale == scale[:, :1]).all(axis=1)] = np.eye(3)
    normal = pack_normal(frame[:, :, 2], int(level["normal_steps"]))
    if free:
        _point_up(frame, normal, int(level["normal_steps"]))
    angle, turned = _angle(frame, normal, angle_bits(scale, level), level)
    if gaussians.sloped:
        slope = _slope_along(turned, frame, slope, scale, level)
    light = pack_light(gaussians.sh[:, 0] * constants.SH_C0, int(level["light_steps"]))
    dc = _sh_dc(light, level)
    pack = pack_group_bands if of_group else pack_bands
    sh = pack(gaussians.sh.astype(np.float64), dc, int(level["sh_steps"]))
    opacity = np.sqrt(np.clip(gaussians.opacity, 0, 1, dtype=np.float64)) * int(level["opacity_steps"])
    slope = np.clip(slope * int(level["slope_steps"]), -SLOPE_CODE_MAX, SLOPE_CODE_MAX)
    codes = {"scale": scale, "normal": normal, "angle": angle, "opacity": _rounded(opacity), "light": light}
    codes |= {"sh": sh, "slope": _rounded(slope)}
    return {name: code.astype(np.int32) for name, code in codes.items()}


def _slices(count: int) -> list[slice]:
    """At least one."""
    return [slice(first, first + AT_ONCE) for first in range(0, max(count, 1), AT_ONCE)]


def _parts(gaussians: Gaussians) -> list[Gaussians]:
    return [Gaussians(*(array[part] for array in vars(gaussians).values())) for part in _slices(len(gaussians))]


def _sh_dc(light: np.ndarray, level: np.ndarray) -> np.ndarray:
    return unpack_light(light, int(level["light_steps"])) / np.float32(constants.SH_C0)


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.rint(values).astype(np.int64)


def _position_floor(position: np.ndarray, scale: np.ndarray, level: np.ndarray) -> int:
    """The least power of two for positions (N, 3) that leaves all coordinates within POSITION_BITS."""
    level["position_floor"] = FLOOR_MIN
    wanted = exponents(scale, level)
    furthest = np.abs(position).max(axis=1, initial=0)
    needed = np.where(furthest > 0, np.frexp(furthest)[1] - POSITION_BITS, FLOOR_MIN)
    short = needed > wanted
    return int(needed[short].max() if short.any() else wanted.min(initial=FLOOR_MAX))


def _with_odd_axis_last(frame: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The axes (N, 3, 3), in columns, and the codes (N, 3) of their lengths; last, the one most unlike the others."""
    order = np.argsort(-scale, axis=1, kind="stable")
    longest, middle, shortest = np.take_along_axis(scale, order, axis=1).T
    order = np.where((longest - middle > middle - shortest)[:, None], order[:, [1, 2, 0]], order)
    frame = np.take_along_axis(frame, order[:, None, :], axis=2)
    frame[:, :, 1] = np.cross(frame[:, :, 2], frame[:, :, 0])
    return frame, np.take_along_axis(scale, order, axis=1)


def _point_up(frame: np.ndarray, normal: np.ndarray, steps: int) -> None:
    """Turn axes (N, 3, 3) whose z axis has the code `normal` (N, 2) by half a turn about x where z points down.

    On the equator down is where x, or else y, is negative.
    """
    height = steps - np.abs(normal).sum(axis=1)
    x, y = normal.T
    down = (height < 0) | (height == 0) & ((x < 0) | (x == 0) & (y < 0))
    frame[down, :, 1:] *= -1
    normal[down] = pack_normal(frame[down, :, 2], steps)


def _angle(frame: np.ndarray, normal: np.ndarray, bits: np.ndarray, level: np.ndarray):
    """The code (N,) of the turn of a frame (N, 3, 3) about its normal (N, 2), and the frame that is decoded from it."""
    z = unpack_normal(normal, int(level["normal_steps"]))
    still = axes(rotation_of(z, np.zeros(len(z))))
    along, across = ((frame[:, :, 0] * still[:, :, i]).sum(axis=1) for i in (0, 1))
    steps = 1 << bits
    code = np.rint(np.arctan2(across, along) / np.pi * steps).astype(np.int64) % steps
    return code, axes(rotation_of(z, code * np.pi / steps))


def _slope_along(
    turned: np.ndarray, frame: np.ndarray, slope: np.ndarray, scale: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """Slopes (N, 2) along the axes of the frame `turned`, of slopes along those of `frame`, both (N, 3, 3).

    Where the first two axes differ by less than an octave in length, the frames may differ by any angle; where they
    differ by more, by a small angle or by half a turn.
    """
    steps = int(level["scale_steps"])
    half = np.where((turned[:, :, 0] * frame[:, :, 0]).sum(axis=1) < 0, -1, 1)[:, None]
    length = powers(scale[:, :2], steps)
    gradient = np.einsum("nik,nk->ni", frame[:, :, :2], slope / length)
    along = np.einsum("nik,ni->nk", turned[:, :, :2], gradient) * length
    return np.where((scale[:, 0] - scale[:, 1] < steps)[:, None], along, half * slope)
