"""Bakes written to a .gsgi file and read again."""

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import HEADER
from gsgi.runtime.file.levels import LOG_SCALE_MAX, SLOPE_STEP
from gsgi.runtime.file.packing import RGB9E5_BIAS, RGB9E5_MANTISSA, RGB9E5_MAX
from gsgi.runtime.gaussians import Bake, Gaussians

from .build import NAMES
from .case import Case, Tolerance

TOLERANCE = Tolerance(1.001, "half a quantisation step, and float32's rounding of what is read")
FLOAT = 2.0**-23
ROTATION_STEP = 1 / (511 * np.sqrt(2))  # of the three components that are stored


@dataclass(frozen=True)
class StoredBake:
    """A bake that is written and read."""

    bake: Bake

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The largest error of an attribute, in halves of its quantisation step."""
        return stored_error(self.bake)


def stored_error(bake: Bake) -> float:
    """The largest error of what is read, in halves of a step. What is read is read again once it is written."""
    data = codec.encode(bake)
    once = codec.decode(data)
    twice = codec.decode(codec.encode(once))
    header = np.frombuffer(data, HEADER, 1)[0]
    errors = [_error(bake.gaussians, once.gaussians, header["fine"])]
    _assert_same(once.gaussians, twice.gaussians)
    if bake.coarse is not None:
        errors.append(_error(bake.coarse, once.coarse, header["coarse"]))
        _assert_same(once.coarse, twice.coarse)
    return max(errors)


def _error(before: Gaussians, after: Gaussians, level: np.void) -> float:
    """The largest error of an attribute in halves of its step, after the policies of runtime/file/FORMAT.md."""
    assert len(before) == len(after)
    if not len(before):
        return 0.0
    for name in NAMES:
        assert np.isfinite(getattr(after, name)).all(), name
    limit = LOG_SCALE_MAX - 1.0
    log_scale = np.log(np.clip(before.scale.astype(float), np.exp(-limit), np.exp(limit)))
    dc = np.clip(before.sh[:, 0].astype(float) * SH_C0, 0, RGB9E5_MAX)
    brightest = dc.max(axis=1, keepdims=True)
    exponent = np.floor(np.log2(np.maximum(brightest, 2.0 ** -(RGB9E5_BIAS + 1)))) + 1
    exponent += np.rint(brightest * 2.0 ** (RGB9E5_MANTISSA - exponent)) == 1 << RGB9E5_MANTISSA  # rounds up into it
    pairs = [
        (before.position, after.position, level["position_step"].astype(float)),
        (log_scale, np.log(after.scale.astype(float)), float(level["log_scale_step"])),
        (np.clip(before.opacity, 0, 1), after.opacity, 1 / 255),
        (dc, after.sh[:, 0] * SH_C0, 2.0 ** (exponent - RGB9E5_MANTISSA)),
    ]
    if before.sloped:
        pairs.append((np.clip(before.slope, -127 * SLOPE_STEP, 127 * SLOPE_STEP), after.slope, SLOPE_STEP))
    shares = []
    for given, read, step in pairs:
        given, read = np.asarray(given, float), np.asarray(read, float)
        # What float32 holds of the box, and of steps that are denormal.
        slack = 2 * FLOAT * np.maximum(np.abs(given), np.abs(given).max(axis=0)) + np.finfo(np.float32).tiny
        shares.append((np.maximum(np.abs(given - read) - slack, 0) / np.maximum(step / 2, 1e-300)).max())
    return float(max(*shares, _rotation_share(before.rotation, after.rotation)))


def _rotation_share(before: np.ndarray, after: np.ndarray) -> float:
    """The largest difference of a component in halves of the step of the three that are stored; 0 is turned to 1."""
    norm = np.linalg.norm(before.astype(float), axis=1, keepdims=True)
    unit = np.where(norm > 0, before / np.where(norm > 0, norm, 1), [0, 0, 0, 1])
    unit = unit * np.where((unit * after).sum(axis=1, keepdims=True) < 0, -1, 1)
    largest = np.abs(unit).argmax(axis=1)
    error = np.abs(unit - after)
    # The largest component takes up the errors of the others, which are at most as large as it is.
    error[np.arange(len(error)), largest] /= 3
    return float(error.max() / (ROTATION_STEP / 2))


def _assert_same(once: Gaussians, twice: Gaussians) -> None:
    """Equal but for the rounding of the steps, which are float32. Of a rotation's components the largest is not stored:
    where two are the largest to within a step, reading may make the other one the largest.
    """
    for name in NAMES:
        a, b = getattr(once, name), getattr(twice, name)
        if name == "rotation":
            b = b * np.where((a * b).sum(axis=1, keepdims=True) < 0, -1, 1)
            np.testing.assert_allclose(b, a, atol=ROTATION_STEP)
            continue
        slack = 4 * FLOAT * max(np.abs(a).max(initial=0), 1e-30)
        np.testing.assert_allclose(b, a, rtol=1e-5 if name == "scale" else 4 * FLOAT, atol=slack, err_msg=name)


def stored_case(
    name: str, build, holds: str = "what is read is within half a step, and is written as it was read",
    refused: tuple[type[Exception], str] | None = None, tolerances: Mapping[str, Tolerance] | None = None,
) -> Case:  # fmt: skip
    """A case of the file of the bake that `build()` returns."""
    return Case("Codec", name, holds, lambda: StoredBake(build()), tolerances or {"file": TOLERANCE}, refused)
