"""A level of a .gsgi file: Gaussians as quantised arrays, and the header record that dequantises them."""

import numpy as np

from gsgi.runtime import constants
from gsgi.runtime.gaussians import BASES, Gaussians

from .packing import pack_rgb9e5, pack_rotation, unpack_rgb9e5, unpack_rotation

LEVEL = np.dtype(
    [
        ("gaussian_count", "<u4"),
        ("sh_degree", "<u2"),
        ("basis", "<u2"),
        ("position_min", "<f4", 3),
        ("position_step", "<f4", 3),
        ("log_scale_min", "<f4"),
        ("log_scale_step", "<f4"),
        ("sh_rest_step", "<f4"),
    ]
)

SLOPE_STEP = 1 / 256  # of the light at the centre, per standard deviation

LOG_SCALE_MAX = 40  # scales within exp(+-40) m keep their variances in float32
SH_REST_STEP_MAX = 1e30  # 127 steps times the largest RGB9E5 value fit in float32


def planes(count: int, sh_degree: int, basis: int) -> np.dtype:
    """The consecutive arrays of a level as a packed dtype; `basis` is an index into BASES."""
    rest = (sh_degree + 1) ** 2 - 1
    fields = [("rotation", "<u4", count), ("sh_dc", "<u4", count), ("position", "<u2", (count, 3))]
    fields += [("scale", "u1", (count, 3)), ("opacity", "u1", count), ("sh_rest", "i1", (count, rest, 3))]
    fields += [("slope", "i1", (count, 2))] if BASES[basis] == "linear" else []
    return np.dtype(fields)


def arrays_bytes(level: np.ndarray) -> int:
    """Size of the arrays that a LEVEL record describes, computed without allocating them."""
    return _planes_of(level).itemsize


def encode_level(gaussians: Gaussians, level: np.ndarray) -> bytes:
    """The arrays of a level as bytes; fills in `level`, a LEVEL record."""
    for name in ("position", "rotation", "scale", "opacity", "sh", "slope"):
        array = getattr(gaussians, name)
        finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
        assert finite.all(), f"Gaussian {finite.argmin()}: {name} is not finite"
    level["gaussian_count"], level["sh_degree"] = len(gaussians), gaussians.sh_degree
    level["basis"] = BASES.index(gaussians.basis)
    body = np.zeros((), _planes_of(level))
    body["rotation"] = pack_rotation(gaussians.rotation)
    body["opacity"] = np.rint(np.clip(gaussians.opacity, 0, 1) * 255)
    _encode_positions(gaussians.position, level, body)
    _encode_scales(gaussians.scale, level, body)
    _encode_sh(gaussians.sh, level, body)
    if gaussians.sloped:
        body["slope"] = np.clip(np.rint(gaussians.slope / SLOPE_STEP), -127, 127)
    return body.tobytes()


def decode_level(level: np.ndarray, data: bytes, offset: int) -> Gaussians:
    """The Gaussians whose arrays begin at byte `offset` of `data`; `level` is their LEVEL record, already checked."""
    body = np.frombuffer(data, _planes_of(level), count=1, offset=offset)[0]
    position = level["position_min"] + body["position"].astype(np.float32) * level["position_step"]
    log_scales = level["log_scale_min"] + np.arange(256, dtype=np.float32) * level["log_scale_step"]
    scales = np.exp(log_scales.astype(np.float64)).astype(np.float32)  # in double, as every reader can
    dc = unpack_rgb9e5(body["sh_dc"]) / np.float32(constants.SH_C0)
    brightest = dc.max(axis=1)[:, None, None]
    rest = body["sh_rest"].astype(np.float32) * level["sh_rest_step"] * brightest
    sloped = BASES[level["basis"]] == "linear"
    return Gaussians(
        position=position.astype(np.float32),
        rotation=unpack_rotation(body["rotation"]),
        scale=scales[body["scale"]],
        opacity=body["opacity"].astype(np.float32) / np.float32(255),
        sh=np.concatenate([dc[:, None, :], rest], axis=1).astype(np.float32),
        slope=body["slope"].astype(np.float32) * np.float32(SLOPE_STEP) if sloped else None,
    )


def check_level(level: np.ndarray, name: str, expect) -> None:
    """Refuse a LEVEL record, called `name`, whose numbers would not decode to finite, usable Gaussians.

    `expect(condition, field, expected, got)` raises if the condition is false. The numbers must be finite.
    """
    for field in ("position_step", "log_scale_step", "sh_rest_step"):
        expect((level[field] >= 0).all(), f"{name}.{field}", "0 or more", level[field])
    low = float(level["log_scale_min"])
    high = low + 255 * float(level["log_scale_step"])
    in_range = low >= -LOG_SCALE_MAX and high <= LOG_SCALE_MAX
    expect(in_range, f"{name}.log_scale_min", f"scales within exp(+-{LOG_SCALE_MAX})", f"exp({low}) to exp({high})")
    corner = np.abs(level["position_min"]) + np.float64(65535) * level["position_step"].astype(np.float64)
    representable = (corner < np.finfo(np.float32).max).all()
    expect(representable, f"{name}.position_step", "positions within float32", level["position_step"])
    step = level["sh_rest_step"]
    expect(step <= SH_REST_STEP_MAX, f"{name}.sh_rest_step", f"at most {SH_REST_STEP_MAX}", step)


def _planes_of(level: np.ndarray) -> np.dtype:
    return planes(int(level["gaussian_count"]), int(level["sh_degree"]), int(level["basis"]))


def _encode_positions(position: np.ndarray, level: np.ndarray, body: np.ndarray) -> None:
    low = position.min(axis=0) if len(position) else np.zeros(3)
    high = position.max(axis=0) if len(position) else np.zeros(3)
    level["position_min"], level["position_step"] = low, (high - low) / 65535
    body["position"] = _quantise(position, level["position_min"], level["position_step"], 65535)


def _encode_scales(scale: np.ndarray, level: np.ndarray, body: np.ndarray) -> None:
    # Stay one below the reader's limit, so that rounding cannot exceed it.
    limit = np.exp(LOG_SCALE_MAX - 1.0)
    log_scale = np.log(np.clip(scale, 1 / limit, limit))
    low, high = (log_scale.min(), log_scale.max()) if len(scale) else (0.0, 0.0)
    level["log_scale_min"], level["log_scale_step"] = low, (high - low) / 255
    body["scale"] = _quantise(log_scale, level["log_scale_min"], level["log_scale_step"], 255)


def _encode_sh(sh: np.ndarray, level: np.ndarray, body: np.ndarray) -> None:
    body["sh_dc"] = pack_rgb9e5(sh[:, 0] * constants.SH_C0)
    decoded_dc = unpack_rgb9e5(body["sh_dc"]) / constants.SH_C0
    brightest = decoded_dc.max(axis=1, initial=0)[:, None, None]
    with np.errstate(over="ignore"):  # an infinite ratio is clipped to the largest code
        ratio = np.divide(sh[:, 1:], brightest, out=np.zeros_like(sh[:, 1:]), where=brightest > 0)
    level["sh_rest_step"] = min(np.abs(ratio).max(initial=0) / 127, SH_REST_STEP_MAX)
    step = level["sh_rest_step"]
    body["sh_rest"] = np.clip(np.rint(ratio / step), -127, 127) if step > 0 else 0


def _quantise(values: np.ndarray, low: np.ndarray, step: np.ndarray, top: int) -> np.ndarray:
    safe = np.where(step > 0, step, 1)
    return np.clip(np.rint((values - low) / safe), 0, top)
