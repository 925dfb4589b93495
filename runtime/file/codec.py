"""The .gsgi codec: a `Bake` to bytes, and back. FORMAT.md beside this file is its specification."""

import math
from dataclasses import asdict, fields, replace

import numpy as np

from gsgi.runtime.errors import FormatError
from gsgi.runtime.gaussians import BASES, Bake, Effects, Gaussians, SurfaceBlend

from .codes import dequantise, light_of, quantise
from .colours import LOG2_MAX
from .header import (
    GAUSSIAN_COUNT_MAX,
    GROUP_TAG,
    HEADER,
    LEVELS,
    MAGIC,
    OPERATOR_NAMES,
    OPERATORS,
    RELIEF_TAG,
    SECTION,
    TAGS,
    VERSION,
    check_counts,
    check_fields,
    checksum,
    read_header,
    section,
    version,
)
from .levels import COARSE_STEPS, FINE_STEPS, LEVEL, OVER_STEPS, decode_level, encode_level
from .light_groups import COARSE_BYTES, GROUP_BYTES, GROUP_STEPS, decode_groups, encode_group
from .relief import RELIEF_BYTES, decode_relief, encode_relief

__all__ = [
    "LIGHT_MAX", "OPERATOR_NAMES", "decode", "encode", "file_bytes", "stored_group", "stored_level", "stored_shapes",
    "version",
]  # fmt: skip

LIGHT_MAX = 2.0**LOG2_MAX  # light in a file is less

# Of a level, of a Gaussian with constant light, of its two slopes and of an SH coefficient of three channels. Default
# bakes of real scenes take less (`./dev bench format`).
LEVEL_BYTES, GAUSSIAN_BYTES, SLOPE_BYTES, SH_BYTES = 110, 12.0, 1.0, 1.6


def file_bytes(
    count: int,
    sh_degree: int,
    coarse_count: int = 0,
    coarse_sh_degree: int = 0,
    basis: str = "constant",
    group_count: int = 0,
    relief: bool = False,
) -> int:
    """The bytes that a .gsgi file with so many Gaussians of that SH degree in its two levels hardly exceeds.

    `basis`, one of BASES, is that of the fine level; the coarse one is "constant". `group_count` is the number of light
    groups, and `relief` says whether the light of the fine level follows normal maps. How much less the file takes
    depends on its shapes and its light: for default bakes a tenth to a third.
    """
    fine = count * (GAUSSIAN_BYTES + SLOPE_BYTES * BASES.index(basis) + SH_BYTES * ((sh_degree + 1) ** 2 - 1))
    fine += count * RELIEF_BYTES * relief
    coarse = coarse_count * (GAUSSIAN_BYTES + SH_BYTES * ((coarse_sh_degree + 1) ** 2 - 1))
    groups = group_count * (LEVEL_BYTES + math.ceil(count * GROUP_BYTES + coarse_count * COARSE_BYTES))
    return HEADER.itemsize + LEVEL_BYTES * (1 + (coarse_count > 0)) + math.ceil(fine + coarse) + groups


def encode(bake: Bake) -> bytes:
    """A bake as the bytes of a .gsgi file; the same bake always gives the same bytes.

    Every number is rounded to a step that follows the Gaussian's own size or light (FORMAT.md), and negative light of
    the constant band to 0. Gaussians change their order, and may exchange their axes. Those that could never be seen
    (opacity below half a step) are the caller's to drop.
    """
    assert (bake.coarse is not None) == isinstance(bake.blend, SurfaceBlend), (bake.coarse, bake.blend)
    count = len(bake.gaussians) + (len(bake.coarse) if bake.coarse is not None else 0)
    assert count <= GAUSSIAN_COUNT_MAX, count
    assert bake.coarse is not None or not bake.groups, bake.groups
    assert bake.coarse is not None or not bake.gaussians.bumpy
    assert 0 <= bake.bounces < 1 << 16, bake.bounces
    assert 0 <= bake.scene < 1 << 64, bake.scene
    header = np.zeros((), HEADER)
    header["magic"], header["version"], header["header_bytes"] = MAGIC, VERSION, HEADER.itemsize
    header["operator"], header["effects"] = OPERATORS.index(type(bake.blend)), int(bake.effects)
    for name, value in asdict(bake.blend).items():
        header[name] = value
        assert header[name] == np.float32(value), (name, value)
    header["tone_scale"], header["bounces"], header["scene"] = bake.tone_scale, bake.bounces, bake.scene
    surface = bake.coarse is not None
    steps = FINE_STEPS if surface else OVER_STEPS
    content, order = encode_level(bake.gaussians, header["fine"], steps, facing=surface)
    body, orders, fine_bytes = section(TAGS["fine"], content), [order], len(content)
    if surface:
        content, order = encode_level(bake.coarse, header["coarse"], COARSE_STEPS, facing=False)
        body += section(TAGS["coarse"], content)
        orders.append(order)
    if bake.gaussians.bumpy:
        sh = decode_level(header["fine"], body, SECTION.itemsize, SECTION.itemsize + fine_bytes, "fine", _expect).sh
        body += section(RELIEF_TAG, encode_relief(bake.gaussians.relief, sh, orders[0]))
    for group in bake.groups:
        body += section(GROUP_TAG, encode_group(group, bake, [header[level] for level in LEVELS], orders))
    check_counts(header, _assert)
    check_fields(header, _assert)
    header["crc32"] = checksum(header.tobytes() + body)
    return header.tobytes() + body


def stored_shapes(gaussians: Gaussians, fine: bool = True) -> Gaussians:
    """The fine or the coarse level of the operator `surface` with the shapes that readers have, in its own order.

    Axes may be exchanged, and slopes turn with them; they are rounded, as shapes are. Other light stays as it is.
    """
    return replace(stored_level(gaussians, fine), sh=gaussians.sh, relief=gaussians.relief)


def stored_level(gaussians: Gaussians, fine: bool = True) -> Gaussians:
    """The same with the light that readers have, too, but without relief."""
    level = _level(FINE_STEPS if fine else COARSE_STEPS)
    return dequantise(quantise(gaussians, level, facing=fine), level)


def stored_group(gaussians: Gaussians, fine: bool = True) -> Gaussians:
    """Gaussians with shapes of a file, in whose order they are, and the light of a group as readers have it."""
    level = _level((FINE_STEPS if fine else COARSE_STEPS) | GROUP_STEPS)
    codes = quantise(gaussians, level, facing=fine, of_group=True)
    sh, slope = light_of(codes.light, codes.sh, codes.slope, level, of_group=True)
    return replace(gaussians, sh=sh, slope=slope)


def _level(steps: dict[str, int]) -> np.ndarray:
    """A LEVEL record with these steps."""
    level = np.zeros((), LEVEL)
    for name, value in steps.items():
        level[name] = value
    return level


def decode(data: bytes) -> Bake:
    """The bake in the bytes of a .gsgi file. Raises FormatError for what the encoder cannot have written."""
    header, sections, groups, relief = read_header(data)
    operator = OPERATORS[int(header["operator"])]
    levels = {name: decode_level(header[name], data, *where, name, _expect) for name, where in sections.items()}
    fine = levels["fine"]
    if relief:
        fine = replace(fine, relief=decode_relief(data, *relief, fine.sh, _expect))
    return Bake(
        fine,
        operator(**{field.name: header[field.name].item() for field in fields(operator)}),
        tone_scale=float(header["tone_scale"]),
        effects=Effects(int(header["effects"])),
        bounces=int(header["bounces"]),
        scene=int(header["scene"]),
        coarse=levels.get("coarse"),
        groups=decode_groups(data, groups, [header[level] for level in LEVELS], _expect),
    )


def _expect(condition: bool, byte: int, field: str, expected: str) -> None:
    if not condition:
        raise FormatError(f"byte {byte} ({field}): expected {expected}")


def _assert(condition: bool, field: str, expected: str, got) -> None:
    assert condition, (field, expected, got)
