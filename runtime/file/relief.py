"""The section of a .gsgi file that says how the light of the fine level follows normal maps."""

import numpy as np

from gsgi.runtime.constants import SH_C0

from .integers import least_bytes, read_integers, write_integers
from .levels import Expect

RELIEF_STEPS = 16  # to the light of a Gaussian's brightest channel
CODE_MAX = 127
RELIEF_BYTES = 7.0  # that the section hardly exceeds, per Gaussian


def encode_relief(relief: np.ndarray, sh: np.ndarray, order: np.ndarray) -> bytes:
    """The content of the section, of relief (N, 3, 3) in the order (N,) of storage.

    `sh` (N, K, 3) is that of the Gaussians as it is decoded, in this order.
    """
    brightest = _brightest(sh).astype(np.float64)
    ratio = np.divide(relief[order], brightest, out=np.zeros(relief.shape), where=brightest > 0)
    code = np.rint(np.clip(ratio * RELIEF_STEPS, -CODE_MAX, CODE_MAX)).astype(np.int64)
    green = code[:, :, 1]
    others = code[:, :, ::2] - green[:, :, None]
    return bytes([RELIEF_STEPS]) + b"".join(write_integers(values.ravel(), False) for values in (green, others))


def decode_relief(data: bytes, at: int, end: int, sh: np.ndarray, expect: Expect) -> np.ndarray:
    """Relief (N, 3, 3) float32 of the bytes `at` to `end` of `data`, for Gaussians with `sh` (N, K, 3)."""
    count = len(sh)
    least = 1 + least_bytes(3 * count) + least_bytes(6 * count)
    expect(end - at >= least, at, "relief", f"at least {least} bytes")
    steps = data[at]
    expect(steps > 0, at, "relief.relief_steps", "at least 1")
    green, at = _codes(data, at + 1, end, "relief.green", np.zeros((count, 3, 1), np.int64), expect)
    others, at = _codes(data, at, end, "relief.red_blue", np.repeat(green, 2, axis=2), expect)
    expect(at == end, at, "relief", "the end of the section")
    code = np.concatenate([others[:, :, :1], green, others[:, :, 1:]], axis=2)
    return code.astype(np.float32) / np.float32(steps) * _brightest(sh)


def _codes(data: bytes, at: int, end: int, field: str, before: np.ndarray, expect: Expect) -> tuple[np.ndarray, int]:
    """Codes of the shape of `before`, what the stream at byte `at` adds to it, and the byte after the stream."""

    def expect_here(condition: bool, byte: int, expected: str) -> None:
        expect(condition, byte, field, expected)

    values, after = read_integers(data, at, end, before.size, expect_here)
    code = before + values.reshape(before.shape)
    expect(bool(np.abs(code).max(initial=0) <= CODE_MAX), at, field, f"steps from {-CODE_MAX} to {CODE_MAX}")
    return code, after


def _brightest(sh: np.ndarray) -> np.ndarray:
    """The constant light (N, 1, 1) float32 of the brightest channel."""
    return (sh[:, 0] * np.float32(SH_C0)).max(axis=1, initial=0)[:, None, None]
