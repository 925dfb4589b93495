"""The header of a .gsgi file and the sections after it: read, and checked."""

import zlib
from dataclasses import fields

import numpy as np

from gsgi.runtime.errors import FormatError
from gsgi.runtime.gaussians import BASES, OverBlend, SurfaceBlend

from .levels import LEVEL, check_level, least_level_bytes

MAGIC = b"GSGI"
VERSION = 6

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

SECTION = np.dtype([("tag", "S4"), ("bytes", "<u4")])
TAGS = {"fine": b"FINE", "coarse": b"COAR"}
GROUP_TAG, RELIEF_TAG = b"GRUP", b"RELF"

Span = tuple[int, int]  # the first byte of a section's content, and the one after the last

OPERATORS = OverBlend, SurfaceBlend  # the operator byte is an index into this
EFFECT_BITS = 0x3FF

OPERATOR_NAMES = {OverBlend: "over", SurfaceBlend: "surface"}
SH_DEGREE_MAX = {OverBlend: 3, SurfaceBlend: 2}

# Of both levels together. It fits the addressing of a 32-bit reader and bounds what a hostile file can ask for.
GAUSSIAN_COUNT_MAX = 1 << 24
SHARPNESS_MAX = 64
FLOOR_MIN, FLOOR_MAX = 2.0**-126, 1e6  # what is less, some machines take for 0


def version(data: bytes) -> int:
    """The format version that the bytes of a .gsgi file state."""
    return int.from_bytes(data[4:6], "little")


def read_header(data: bytes) -> tuple[np.ndarray, dict[str, Span], list[Span], Span | None]:
    """The header of a .gsgi file as a record of HEADER, and where the sections of levels, groups and relief are.

    Raises FormatError unless every field, the sections and the checksum are ones that the encoder could have written.
    Sections of other tags are skipped.
    """
    if len(data) < HEADER.itemsize:
        raise FormatError(f"byte {len(data)}: expected a header of {HEADER.itemsize} bytes, the file ends here")
    header = np.frombuffer(data, HEADER, count=1)[0]

    def expect(condition: bool, field: str, expected: str, got) -> None:
        if not condition:
            raise FormatError(f"byte {_offset(field)} ({field}): expected {expected}, got {got}")

    magic = header["magic"].item()
    world = ": is it the manifest of a world, where one file of light is asked for?" if magic[:1] == b"{" else ""
    expect(magic == MAGIC, "magic", repr(MAGIC), f"{magic!r}{world}")
    expect(header["version"] == VERSION, "version", f"{VERSION}", header["version"])
    expect(header["header_bytes"] == HEADER.itemsize, "header_bytes", f"{HEADER.itemsize}", header["header_bytes"])
    check_counts(header, expect)
    levels, groups, relief = _sections(header, data)
    crc = checksum(data)
    expect(header["crc32"] == crc, "crc32", f"{crc:#010x}", f"{int(header['crc32']):#010x}: the file is damaged")
    check_fields(header, expect)
    return header, levels, groups, relief


def section(tag: bytes, content: bytes) -> bytes:
    """A section: `tag` of four bytes, the length of the content, and the content."""
    return np.array((tag, len(content)), SECTION).tobytes() + content


def _sections(header: np.ndarray, data: bytes) -> tuple[dict[str, Span], list[Span], Span | None]:
    """Where the sections are: of levels, which come first and are long enough for their Gaussians, groups, relief."""
    names = LEVELS if header["operator"] == OPERATORS.index(SurfaceBlend) else LEVELS[:1]
    at, found, groups, relief = HEADER.itemsize, {}, [], None
    while at < len(data) or len(found) < len(names):
        name = names[len(found)] if len(found) < len(names) else None
        known = name or "section"
        if at + SECTION.itemsize > len(data):
            raise FormatError(f"byte {len(data)} ({known}): expected a section, the file ends here")
        tag, size = np.frombuffer(data, SECTION, 1, at)[0].tolist()
        if name and tag != TAGS[name]:
            raise FormatError(f"byte {at} ({known}): expected {TAGS[name]!r}, got {tag!r}")
        least = least_level_bytes(header[name]) if name else 0
        if not least <= size:
            raise FormatError(f"byte {at + 4} ({known}): expected at least {least} bytes, got {size}")
        at += SECTION.itemsize
        if size > len(data) - at:
            raise FormatError(f"byte {len(data)} ({known}): expected {size} bytes from byte {at}, the file ends here")
        if name:
            found[name] = at, at + size
        elif tag in TAGS.values():
            raise FormatError(f"byte {at - SECTION.itemsize} (section): expected no second {tag!r}")
        elif tag in (GROUP_TAG, RELIEF_TAG):
            if names != LEVELS:
                raise FormatError(f"byte {at - SECTION.itemsize} (section): expected no {tag!r}, since over has none")
            if tag == GROUP_TAG:
                groups.append((at, at + size))
            elif relief:
                raise FormatError(f"byte {at - SECTION.itemsize} (section): expected no second {tag!r}")
            else:
                relief = at, at + size
        at += size
    return found, groups, relief


def checksum(data: bytes) -> int:
    """CRC-32 of a file whose own field for it counts as 0."""
    at = HEADER.fields["crc32"][1]
    return zlib.crc32(data[at + 4 :], zlib.crc32(bytes(4), zlib.crc32(data[:at])))


def check_counts(header: np.ndarray, expect) -> None:
    """Refuse what the sections cannot follow from, by `expect(condition, field, expected, got)`."""
    numbers = " or ".join(f"{i} ({OPERATOR_NAMES[blend]})" for i, blend in enumerate(OPERATORS))
    expect(header["operator"] < len(OPERATORS), "operator", numbers, header["operator"])
    highest, total = SH_DEGREE_MAX[OPERATORS[int(header["operator"])]], 0
    for level in LEVELS:
        total += int(header[level]["gaussian_count"])
        expect(total <= GAUSSIAN_COUNT_MAX, f"{level}.gaussian_count", f"at most {GAUSSIAN_COUNT_MAX}", total)
        degree = header[level]["sh_degree"]
        expect(degree <= highest, f"{level}.sh_degree", f"0 to {highest}", degree)
        known, basis = " or ".join(f"{i} ({name})" for i, name in enumerate(BASES)), header[level]["basis"]
        expect(basis < len(BASES), f"{level}.basis", known, basis)


def check_fields(header: np.ndarray, expect) -> None:
    """Refuse what else the encoder never writes, in the same way."""
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
    for level in LEVELS if operator is SurfaceBlend else LEVELS[:1]:
        check_level(header[level], level, expect)


def _offset(field: str) -> int:
    """Where `field` or `level.field` begins in a file."""
    level, _, name = field.rpartition(".")
    return HEADER.fields[level][1] + LEVEL.fields[name][1] if level else HEADER.fields[name][1]


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
    expect(FLOOR_MIN <= header["floor"] <= FLOOR_MAX, "floor", f"2^-126 to {FLOOR_MAX:g}", header["floor"])
    expect(1 <= header["sharpness"] <= SHARPNESS_MAX, "sharpness", f"1 to {SHARPNESS_MAX}", header["sharpness"])
    basis = header["coarse"]["basis"]
    expect(basis == 0, "coarse.basis", "0, since only fine Gaussians have slopes", basis)
