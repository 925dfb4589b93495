"""The .gsgi codec: a `Bake` to bytes, and back. FORMAT.md beside this file is its specification."""

from dataclasses import asdict, fields

import numpy as np

from gsgi.runtime.gaussians import BASES, Bake, Effects, SurfaceBlend

from .header import (
    GAUSSIAN_COUNT_MAX,
    HEADER,
    MAGIC,
    OPERATOR_NAMES,
    OPERATORS,
    VERSION,
    check_fields,
    checksum,
    read_header,
    version,
)
from .levels import arrays_bytes, decode_level, encode_level, planes

__all__ = ["OPERATOR_NAMES", "decode", "encode", "file_bytes", "version"]


def file_bytes(
    count: int, sh_degree: int, coarse_count: int = 0, coarse_sh_degree: int = 0, basis: str = "constant"
) -> int:
    """Size of a .gsgi file with that many Gaussians of that SH degree in its fine and in its coarse level.

    `basis`, one of BASES, is that of the fine level; the coarse one is "constant".
    """
    fine = planes(count, sh_degree, BASES.index(basis))
    return HEADER.itemsize + fine.itemsize + planes(coarse_count, coarse_sh_degree, 0).itemsize


def encode(bake: Bake) -> bytes:
    """A bake as the bytes of a .gsgi file; the same bake always gives the same bytes.

    In each level positions keep 1/65535 of its bounding box, scales 1/255 of its logarithmic range, rotations 3 x 10
    bits, opacities 8 bits, colours the nine bits of RGB9E5, which has no negative ones, and higher SH coefficients and
    slopes 8 bits. Gaussians that could never be seen (opacity below half a quantisation step) are the caller's to drop.
    """
    assert (bake.coarse is not None) == isinstance(bake.blend, SurfaceBlend), (bake.coarse, bake.blend)
    count = len(bake.gaussians) + (len(bake.coarse) if bake.coarse is not None else 0)
    assert count <= GAUSSIAN_COUNT_MAX, count
    assert 0 <= bake.bounces < 1 << 16, bake.bounces
    assert 0 <= bake.scene < 1 << 64, bake.scene
    header = np.zeros((), HEADER)
    header["magic"], header["version"], header["header_bytes"] = MAGIC, VERSION, HEADER.itemsize
    header["operator"], header["effects"] = OPERATORS.index(type(bake.blend)), int(bake.effects)
    for name, value in asdict(bake.blend).items():
        header[name] = value
        assert header[name] == np.float32(value), (name, value)
    header["tone_scale"], header["bounces"], header["scene"] = bake.tone_scale, bake.bounces, bake.scene
    body = encode_level(bake.gaussians, header["fine"])
    if bake.coarse is not None:
        body += encode_level(bake.coarse, header["coarse"])
    check_fields(header, _assert)
    header["crc32"] = checksum(header.tobytes() + body)
    return header.tobytes() + body


def decode(data: bytes) -> Bake:
    """The bake in the bytes of a .gsgi file. Raises FormatError for what the encoder cannot have written."""
    header = read_header(data)
    operator = OPERATORS[int(header["operator"])]
    fine = HEADER.itemsize
    coarse = fine + arrays_bytes(header["fine"])
    return Bake(
        decode_level(header["fine"], data, fine),
        operator(**{field.name: header[field.name].item() for field in fields(operator)}),
        tone_scale=float(header["tone_scale"]),
        effects=Effects(int(header["effects"])),
        bounces=int(header["bounces"]),
        scene=int(header["scene"]),
        coarse=decode_level(header["coarse"], data, coarse) if operator is SurfaceBlend else None,
    )


def _assert(condition: bool, field: str, expected: str, got) -> None:
    assert condition, (field, expected, got)
