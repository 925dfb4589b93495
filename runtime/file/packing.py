"""Pack a rotation or a colour of a .gsgi file into 32 bits."""

import numpy as np

# EXT_texture_shared_exponent: 9-bit mantissas, exponent bias 15.
RGB9E5_BIAS = 15
RGB9E5_MANTISSA = 9
RGB9E5_MAX = 65408.0  # (511 / 512) * 2^16


def pack_rotation(rotation: np.ndarray) -> np.ndarray:
    """Pack quaternions xyzw (N, 4) to (N,) uint32 by the smallest-three method.

    The top 2 bits hold the index of the largest component; the others follow with 10 bits each, in xyzw order.
    """
    rotation = rotation.astype(np.float64)  # in which no square overflows
    norm = np.linalg.norm(rotation, axis=1, keepdims=True)
    unit = np.where(norm > 0, rotation / np.where(norm > 0, norm, 1), [0, 0, 0, 1])
    largest = np.abs(unit).argmax(axis=1)
    unit = unit * np.where(np.take_along_axis(unit, largest[:, None], 1) < 0, -1, 1)
    others = unit[np.arange(4) != largest[:, None]].reshape(-1, 3)
    codes = np.rint(others * (511 * np.sqrt(2)) + 511).clip(0, 1022).astype(np.uint32)
    return largest.astype(np.uint32) << 30 | codes[:, 0] << 20 | codes[:, 1] << 10 | codes[:, 2]


def unpack_rotation(packed: np.ndarray) -> np.ndarray:
    """Unpack (N,) uint32 to unit quaternions xyzw (N, 4) float32; any bit pattern is valid."""
    largest = packed >> 30
    codes = np.stack([packed >> 20 & 1023, packed >> 10 & 1023, packed & 1023], axis=1)
    others = (codes.astype(np.float32) - 511) / np.float32(511 * np.sqrt(2))
    rotation = np.empty((len(packed), 4), np.float32)
    rotation[np.arange(4) != largest[:, None]] = others.ravel()
    rotation[np.arange(4) == largest[:, None]] = np.sqrt(np.maximum(0, 1 - (others**2).sum(axis=1)))
    return rotation / np.linalg.norm(rotation, axis=1, keepdims=True)


def pack_rgb9e5(rgb: np.ndarray) -> np.ndarray:
    """Pack linear colours (N, 3), clamped to [0, 65408], to (N,) uint32: EXT_texture_shared_exponent (Khronos 2008)."""
    rgb = np.clip(np.asarray(rgb, np.float64), 0, RGB9E5_MAX)
    brightest = np.maximum(rgb.max(axis=1, initial=0), 2.0 ** -(RGB9E5_BIAS + 1))
    exponent = np.floor(np.log2(brightest)).astype(np.int64) + 1 + RGB9E5_BIAS
    overflow = np.rint(brightest / 2.0 ** (exponent - RGB9E5_BIAS - RGB9E5_MANTISSA)) == 1 << RGB9E5_MANTISSA
    exponent += overflow
    step = 2.0 ** (exponent - RGB9E5_BIAS - RGB9E5_MANTISSA)
    mantissa = np.rint(rgb / step[:, None]).astype(np.uint32)
    return mantissa[:, 0] | mantissa[:, 1] << 9 | mantissa[:, 2] << 18 | exponent.astype(np.uint32) << 27


def unpack_rgb9e5(packed: np.ndarray) -> np.ndarray:
    """Unpack (N,) uint32 to linear colours (N, 3) float32 in [0, 65408]; any bit pattern is valid."""
    mantissa = np.stack([packed & 511, packed >> 9 & 511, packed >> 18 & 511], axis=1).astype(np.float32)
    exponent = (packed >> 27).astype(np.int32) - RGB9E5_BIAS - RGB9E5_MANTISSA
    return np.ldexp(mantissa, exponent[:, None]).astype(np.float32)
