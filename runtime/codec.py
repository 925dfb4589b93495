"""The .gsgi codec: a `Bake` to bytes, and back. FORMAT.md beside this file is its specification."""

import struct
import zlib

import numpy as np

from . import constants
from .errors import FormatError
from .gaussians import Bake, Effects, Gaussians, OverBlend

MAGIC = b"GSGI"
VERSION = 2
OPERATOR_OVER = 0

HEADER_1 = np.dtype(
    [
        ("magic", "S4"),
        ("version", "<u2"),
        ("header_bytes", "<u2"),
        ("crc32", "<u4"),
        ("gaussian_count", "<u4"),
        ("sh_degree", "u1"),
        ("operator", "u1"),
        ("effects", "<u2"),
        ("near", "<f4"),
        ("dilation", "<f4"),
        ("alpha_min", "<f4"),
        ("alpha_max", "<f4"),
        ("tone_scale", "<f4"),
        ("position_min", "<f4", 3),
        ("position_step", "<f4", 3),
        ("log_scale_min", "<f4"),
        ("log_scale_step", "<f4"),
        ("sh_rest_step", "<f4"),
    ]
)
HEADER = np.dtype([*HEADER_1.descr, ("bounces", "<u2"), ("reserved", "<u2"), ("scene", "<u8")])

HEADERS = {1: HEADER_1, 2: HEADER}
EFFECT_BITS = {1: 0x0F, 2: 0xFF}  # that each version knows

# Counts up to here fit the addressing of a 32-bit reader (18 bytes each) and bound what a hostile file can ask for.
GAUSSIAN_COUNT_MAX = 1 << 24

# EXT_texture_shared_exponent: nine bits of mantissa, exponent bias 15.
RGB9E5_BIAS = 15
RGB9E5_MANTISSA = 9
RGB9E5_MAX = 65408.0  # (511 / 512) * 2^16


def planes(count: int, sh_degree: int) -> np.dtype:
    """The arrays that follow the header, one after the other, as a packed dtype."""
    rest = (sh_degree + 1) ** 2 - 1
    fields = [("rotation", "<u4", count), ("sh_dc", "<u4", count), ("position", "<u2", (count, 3))]
    fields += [("scale", "u1", (count, 3)), ("opacity", "u1", count), ("sh_rest", "i1", (count, rest, 3))]
    return np.dtype(fields)


def encode(bake: Bake) -> bytes:
    """A bake as the bytes of a .gsgi file; the same bake always gives the same bytes.

    Positions keep 1/65535 of the bounding box, scales 1/255 of their logarithmic range, rotations 3 x 10 bits,
    opacities 8 bits, colours the nine bits of RGB9E5. Gaussians that could never be seen (opacity below half a
    quantisation step of `alpha_min`) are the caller's to drop.
    """
    gaussians, blend = bake.gaussians, bake.blend
    assert len(gaussians) <= GAUSSIAN_COUNT_MAX, len(gaussians)
    assert all(np.isfinite(getattr(gaussians, name)).all() for name in ("position", "scale", "opacity", "sh"))
    assert int(bake.effects) | EFFECT_BITS[VERSION] == EFFECT_BITS[VERSION], bake.effects
    assert 0 <= bake.bounces < 1 << 16, bake.bounces
    assert 0 <= bake.scene < 1 << 64, bake.scene
    header = np.zeros((), HEADER)
    header["magic"], header["version"], header["header_bytes"] = MAGIC, VERSION, HEADER.itemsize
    header["gaussian_count"], header["sh_degree"] = len(gaussians), gaussians.sh_degree
    header["operator"], header["effects"] = OPERATOR_OVER, int(bake.effects)
    for name in ("near", "dilation", "alpha_min", "alpha_max"):
        header[name] = getattr(blend, name)
    header["tone_scale"], header["bounces"], header["scene"] = bake.tone_scale, bake.bounces, bake.scene

    body = np.zeros((), planes(len(gaussians), gaussians.sh_degree))
    body["rotation"] = _pack_rotation(gaussians.rotation)
    body["opacity"] = np.rint(np.clip(gaussians.opacity, 0, 1) * 255)
    _encode_positions(gaussians.position, header, body)
    _encode_scales(gaussians.scale, header, body)
    _encode_sh(gaussians.sh, header, body)

    data = header.tobytes() + body.tobytes()
    at = HEADER.fields["crc32"][1]
    return data[:at] + struct.pack("<I", zlib.crc32(data)) + data[at + 4 :]


def decode(data: bytes) -> Bake:
    """The bake in the bytes of a .gsgi file of any version. Raises FormatError for anything that none of them wrote."""
    header = _read_header(data)
    count, degree = int(header["gaussian_count"]), int(header["sh_degree"])
    layout = planes(count, degree)
    body = np.frombuffer(data, layout, count=1, offset=int(header["header_bytes"]))[0]
    position = header["position_min"] + body["position"].astype(np.float32) * header["position_step"]
    scale = np.exp(header["log_scale_min"] + body["scale"].astype(np.float32) * header["log_scale_step"])
    dc = _unpack_rgb9e5(body["sh_dc"]) / np.float32(constants.SH_C0)
    brightest = dc.max(axis=1)[:, None, None]
    rest = body["sh_rest"].astype(np.float32) * header["sh_rest_step"] * brightest
    gaussians = Gaussians(
        position=position.astype(np.float32),
        rotation=_unpack_rotation(body["rotation"]),
        scale=scale.astype(np.float32),
        opacity=body["opacity"].astype(np.float32) / np.float32(255),
        sh=np.concatenate([dc[:, None, :], rest], axis=1).astype(np.float32),
    )
    blend = OverBlend(*(float(header[name]) for name in ("near", "dilation", "alpha_min", "alpha_max")))
    return Bake(
        gaussians,
        blend,
        tone_scale=float(header["tone_scale"]),
        effects=Effects(int(header["effects"])),
        bounces=int(header["bounces"]),
        scene=int(header["scene"]),
    )


def version(data: bytes) -> int:
    """The format version that the bytes of a .gsgi file state."""
    return int.from_bytes(data[4:6], "little")


def _parse_header(data: bytes) -> np.void:
    """The header, not checked, as a record of HEADER: fields that the file's version lacks are 0."""
    layout = HEADERS.get(version(data), HEADER)
    if len(data) < layout.itemsize:
        raise FormatError(f"byte {len(data)}: expected a header of {layout.itemsize} bytes, the file ends here")
    stated = np.frombuffer(data, layout, count=1)[0]
    header = np.zeros(1, HEADER)[0]
    for name in layout.names:
        header[name] = stated[name]
    return header


def _read_header(data: bytes) -> np.void:
    """The same, every field of it checked, and the length and checksum of what follows."""

    def expect(condition: bool, field: str, expected: str, got) -> None:
        if not condition:
            offset = HEADER.fields[field][1]
            raise FormatError(f"byte {offset} ({field}): expected {expected}, got {got}")

    header = _parse_header(data)
    expect(bytes(header["magic"]) == MAGIC, "magic", repr(MAGIC), repr(bytes(header["magic"])))
    expect(header["version"] in HEADERS, "version", " or ".join(map(str, HEADERS)), header["version"])
    header_bytes, known = HEADERS[int(header["version"])].itemsize, EFFECT_BITS[int(header["version"])]
    expect(header["header_bytes"] == header_bytes, "header_bytes", f"{header_bytes}", header["header_bytes"])
    count, degree = int(header["gaussian_count"]), int(header["sh_degree"])
    expect(count <= GAUSSIAN_COUNT_MAX, "gaussian_count", f"at most {GAUSSIAN_COUNT_MAX}", count)
    expect(degree <= 3, "sh_degree", "0 to 3", degree)
    expect(header["operator"] == OPERATOR_OVER, "operator", f"{OPERATOR_OVER} (over)", header["operator"])
    expect(header["effects"] | known == known, "effects", f"bits of {known:#x}", hex(header["effects"]))
    expect(header["reserved"] == 0, "reserved", "0", header["reserved"])
    size = header_bytes + planes(count, degree).itemsize
    if len(data) != size:
        raise FormatError(f"byte {min(len(data), size)}: expected {size} bytes for {count} Gaussians, got {len(data)}")
    at = HEADER.fields["crc32"][1]
    crc = zlib.crc32(data[at + 4 :], zlib.crc32(bytes(4), zlib.crc32(data[:at])))
    expect(header["crc32"] == crc, "crc32", f"{crc:#010x}", f"{int(header['crc32']):#010x}: the file is damaged")
    _check_numbers(header, expect)
    return header


def _check_numbers(header: np.void, expect) -> None:
    """Refuse header numbers from which no finite, usable Gaussian could be decoded."""
    for name in HEADER.names:
        if HEADER[name].base.kind == "f":
            expect(np.isfinite(header[name]).all(), name, "finite numbers", header[name])
    for name in ("near", "dilation", "position_step", "log_scale_step", "sh_rest_step"):
        expect((header[name] >= 0).all(), name, "0 or more", header[name])
    expect(header["tone_scale"] > 0, "tone_scale", "more than 0", header["tone_scale"])
    expect(
        0 < header["alpha_min"] < header["alpha_max"] < 1,
        "alpha_min",
        "0 < alpha_min < alpha_max < 1",
        header["alpha_min"],
    )
    log_scale_max = header["log_scale_min"] + 255 * header["log_scale_step"]
    # exp(+-40): beyond it, variances leave float32.
    expect(header["log_scale_min"] >= -40 and log_scale_max <= 40, "log_scale_min", "within +-40", log_scale_max)
    corner = np.abs(header["position_min"]) + np.float64(65535) * header["position_step"].astype(np.float64)
    expect(
        (corner < np.finfo(np.float32).max).all(), "position_step", "positions within float32", header["position_step"]
    )


def _encode_positions(position: np.ndarray, header: np.ndarray, body: np.ndarray) -> None:
    low = position.min(axis=0) if len(position) else np.zeros(3)
    high = position.max(axis=0) if len(position) else np.zeros(3)
    header["position_min"], header["position_step"] = low, (high - low) / 65535
    body["position"] = _quantise(position, header["position_min"], header["position_step"], 65535)


def _encode_scales(scale: np.ndarray, header: np.ndarray, body: np.ndarray) -> None:
    # exp(+-40) bounds what a reader accepts.
    log_scale = np.log(np.clip(scale, np.exp(-39.0), np.exp(39.0)))
    low, high = (log_scale.min(), log_scale.max()) if len(scale) else (0.0, 0.0)
    header["log_scale_min"], header["log_scale_step"] = low, (high - low) / 255
    body["scale"] = _quantise(log_scale, header["log_scale_min"], header["log_scale_step"], 255)


def _encode_sh(sh: np.ndarray, header: np.ndarray, body: np.ndarray) -> None:
    body["sh_dc"] = _pack_rgb9e5(sh[:, 0] * constants.SH_C0)
    decoded_dc = _unpack_rgb9e5(body["sh_dc"]) / constants.SH_C0
    brightest = decoded_dc.max(axis=1, initial=0)[:, None, None]
    ratio = np.divide(sh[:, 1:], brightest, out=np.zeros_like(sh[:, 1:]), where=brightest > 0)
    header["sh_rest_step"] = np.abs(ratio).max(initial=0) / 127
    step = header["sh_rest_step"]
    body["sh_rest"] = np.clip(np.rint(ratio / step), -127, 127) if step > 0 else 0


def _quantise(values: np.ndarray, low: np.ndarray, step: np.ndarray, top: int) -> np.ndarray:
    safe = np.where(step > 0, step, 1)
    return np.clip(np.rint((values - low) / safe), 0, top)


def _pack_rotation(rotation: np.ndarray) -> np.ndarray:
    """Smallest three: index of the largest component in the top 2 bits, the others in 10 bits each, xyzw order."""
    norm = np.linalg.norm(rotation, axis=1, keepdims=True)
    unit = np.where(norm > 0, rotation / np.where(norm > 0, norm, 1), [0, 0, 0, 1])
    largest = np.abs(unit).argmax(axis=1)
    unit = unit * np.where(np.take_along_axis(unit, largest[:, None], 1) < 0, -1, 1)
    others = unit[np.arange(4) != largest[:, None]].reshape(-1, 3)
    codes = np.rint(others * (511 * np.sqrt(2)) + 511).clip(0, 1022).astype(np.uint32)
    return largest.astype(np.uint32) << 30 | codes[:, 0] << 20 | codes[:, 1] << 10 | codes[:, 2]


def _unpack_rotation(packed: np.ndarray) -> np.ndarray:
    largest = packed >> 30
    codes = np.stack([packed >> 20 & 1023, packed >> 10 & 1023, packed & 1023], axis=1)
    others = (codes.astype(np.float32) - 511) / np.float32(511 * np.sqrt(2))
    rotation = np.empty((len(packed), 4), np.float32)
    rotation[np.arange(4) != largest[:, None]] = others.ravel()
    rotation[np.arange(4) == largest[:, None]] = np.sqrt(np.maximum(0, 1 - (others**2).sum(axis=1)))
    return rotation / np.linalg.norm(rotation, axis=1, keepdims=True)


def _pack_rgb9e5(rgb: np.ndarray) -> np.ndarray:
    """EXT_texture_shared_exponent (Khronos 2008): (N, 3) linear, clamped to [0, 65408] -> (N,) uint32."""
    rgb = np.clip(np.asarray(rgb, np.float64), 0, RGB9E5_MAX)
    brightest = np.maximum(rgb.max(axis=1, initial=0), 2.0 ** -(RGB9E5_BIAS + 1))
    exponent = np.floor(np.log2(brightest)).astype(np.int64) + 1 + RGB9E5_BIAS
    overflow = np.rint(brightest / 2.0 ** (exponent - RGB9E5_BIAS - RGB9E5_MANTISSA)) == 1 << RGB9E5_MANTISSA
    exponent += overflow
    step = 2.0 ** (exponent - RGB9E5_BIAS - RGB9E5_MANTISSA)
    mantissa = np.rint(rgb / step[:, None]).astype(np.uint32)
    return mantissa[:, 0] | mantissa[:, 1] << 9 | mantissa[:, 2] << 18 | exponent.astype(np.uint32) << 27


def _unpack_rgb9e5(packed: np.ndarray) -> np.ndarray:
    mantissa = np.stack([packed & 511, packed >> 9 & 511, packed >> 18 & 511], axis=1).astype(np.float32)
    exponent = (packed >> 27).astype(np.int32) - RGB9E5_BIAS - RGB9E5_MANTISSA
    return np.ldexp(mantissa, exponent[:, None]).astype(np.float32)
