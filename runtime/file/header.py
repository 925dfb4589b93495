"""The header of a .gsgi file: its fields, read and checked."""

import zlib
from dataclasses import fields

import numpy as np

from gsgi.runtime.errors import FormatError
from gsgi.runtime.gaussians import BASES, OverBlend, SurfaceBlend

from .levels import LEVEL, arrays_bytes, check_level

MAGIC = b"GSGI"
VERSION = 4

HEADER = np.dtype(
    [
        ("magic", "S4"),
        ("version", "<u2"),
        ("header_bytes", "<u2"),
        ("crc32", "<u4"),
        ("operator", "u1"),
        ("sharpness", "u1"),
        ("effects", "<u2"),
        ("bounces", "<u2"),
        ("reserved", "<u2"),
        ("tone_scale", "<f4"),
        ("scene", "<u8"),
        ("near", "<f4"),
        ("dilation", "<f4"),
        ("alpha_min", "<f4"),
        ("alpha_max", "<f4"),
        ("cutoff", "<f4"),
        ("floor", "<f4"),
        ("fine", LEVEL),
        ("coarse", LEVEL),
    ]
)
LEVELS = ("fine", "coarse")

OPERATORS = OverBlend, SurfaceBlend  # the operator byte is an index into this
EFFECT_BITS = 0x1FF

OPERATOR_NAMES = {OverBlend: "over", SurfaceBlend: "surface"}
SH_DEGREE_MAX = {OverBlend: 3, SurfaceBlend: 2}

# Of both levels together. It fits the addressing of a 32-bit reader and bounds what a hostile file can ask for.
GAUSSIAN_COUNT_MAX = 1 << 24
SHARPNESS_MAX = 64
FLOOR_MAX = 1e6


def version(data: bytes) -> int:
    """The format version that the bytes of a .gsgi file state."""
    return int.from_bytes(data[4:6], "little")


def read_header(data: bytes) -> np.ndarray:
    """The header of a .gsgi file as a record of HEADER.

    Raises FormatError unless every field, the length and the checksum are ones that the encoder could have written.
    """
    if len(data) < HEADER.itemsize:
        raise FormatError(f"byte {len(data)}: expected a header of {HEADER.itemsize} bytes, the file ends here")
    header = np.frombuffer(data, HEADER, count=1)[0]

    def expect(condition: bool, field: str, expected: str, got) -> None:
        if not condition:
            raise FormatError(f"byte {_offset(field)} ({field}): expected {expected}, got {got}")

    magic = header["magic"].item()
    expect(magic == MAGIC, "magic", repr(MAGIC), repr(magic))
    expect(header["version"] == VERSION, "version", f"{VERSION}", header["version"])
    expect(header["header_bytes"] == HEADER.itemsize, "header_bytes", f"{HEADER.itemsize}", header["header_bytes"])
    _check_counts(header, expect)
    count = sum(int(header[level]["gaussian_count"]) for level in LEVELS)
    size = HEADER.itemsize + sum(arrays_bytes(header[level]) for level in LEVELS)
    if len(data) != size:
        raise FormatError(f"byte {min(len(data), size)}: expected {size} bytes for {count} Gaussians, got {len(data)}")
    crc = checksum(data)
    expect(header["crc32"] == crc, "crc32", f"{crc:#010x}", f"{int(header['crc32']):#010x}: the file is damaged")
    check_fields(header, expect)
    return header


def checksum(data: bytes) -> int:
    """CRC-32 of a file whose own field for it counts as 0."""
    at = HEADER.fields["crc32"][1]
    return zlib.crc32(data[at + 4 :], zlib.crc32(bytes(4), zlib.crc32(data[:at])))


def check_fields(header: np.ndarray, expect) -> None:
    """Refuse what the encoder never writes, by `expect(condition, field, expected, got)`."""
    numbers = " or ".join(f"{i} ({OPERATOR_NAMES[blend]})" for i, blend in enumerate(OPERATORS))
    expect(header["operator"] < len(OPERATORS), "operator", numbers, header["operator"])
    known = header["effects"] | EFFECT_BITS == EFFECT_BITS
    expect(known, "effects", f"bits of {EFFECT_BITS:#x}", hex(header["effects"]))
    expect(header["reserved"] == 0, "reserved", "0", header["reserved"])
    _check_finite(header, "", expect)
    expect(header["tone_scale"] > 0, "tone_scale", "more than 0", header["tone_scale"])
    operator = OPERATORS[int(header["operator"])]
    for other in set(OPERATORS) - {operator}:
        for field in fields(other):
            expect(
                header[field.name] == 0, field.name, f"0, since {OPERATOR_NAMES[operator]} has none", header[field.name]
            )
    {OverBlend: _check_over, SurfaceBlend: _check_surface}[operator](header, expect)
    for level in LEVELS:
        degree, highest = header[level]["sh_degree"], SH_DEGREE_MAX[operator]
        expect(degree <= highest, f"{level}.sh_degree", f"0 to {highest}", degree)
        check_level(header[level], level, expect)


def _offset(field: str) -> int:
    """Where `field` or `level.field` begins in a file."""
    level, _, name = field.rpartition(".")
    return HEADER.fields[level][1] + LEVEL.fields[name][1] if level else HEADER.fields[name][1]


def _check_counts(header: np.ndarray, expect) -> None:
    """What the length follows from: small enough to compute with."""
    total = 0
    for level in LEVELS:
        total += int(header[level]["gaussian_count"])
        expect(total <= GAUSSIAN_COUNT_MAX, f"{level}.gaussian_count", f"at most {GAUSSIAN_COUNT_MAX}", total)
        degree = header[level]["sh_degree"]
        expect(degree <= 3, f"{level}.sh_degree", "0 to 3", degree)
        known, basis = " or ".join(f"{i} ({name})" for i, name in enumerate(BASES)), header[level]["basis"]
        expect(basis < len(BASES), f"{level}.basis", known, basis)


def _check_finite(record: np.ndarray, prefix: str, expect) -> None:
    for name in record.dtype.names:
        if record.dtype[name].names:
            _check_finite(record[name], f"{name}.", expect)
        elif record.dtype[name].base.kind == "f":
            expect(np.isfinite(record[name]).all(), prefix + name, "finite numbers", record[name])


def _check_over(header: np.ndarray, expect) -> None:
    for name in ("near", "dilation"):
        expect(header[name] >= 0, name, "0 or more", header[name])
    ordered = 0 < header["alpha_min"] < header["alpha_max"] < 1
    expect(ordered, "alpha_min", "0 < alpha_min < alpha_max < 1", header["alpha_min"])
    expect(header["fine"]["basis"] == 0, "fine.basis", "0, since over has no slopes", header["fine"]["basis"])
    expect(not any(header["coarse"].tobytes()), "coarse", "zeros, since over has none", header["coarse"])


def _check_surface(header: np.ndarray, expect) -> None:
    expect(0 < header["cutoff"] < 1, "cutoff", "more than 0, less than 1", header["cutoff"])
    expect(0 < header["floor"] <= FLOOR_MAX, "floor", f"more than 0, at most {FLOOR_MAX:g}", header["floor"])
    expect(1 <= header["sharpness"] <= SHARPNESS_MAX, "sharpness", f"1 to {SHARPNESS_MAX}", header["sharpness"])
