"""Light of a .gsgi file: each channel as a logarithm, so that errors are relative to the light, however faint it is."""

import numpy as np

LOG2_MIN, LOG2_MAX = -32, 16  # light is at least 2^-32 and less than 2^16, as half floats are; code 0 is black
DARK = 10  # a channel 2^DARK times darker than the brightest one is stored as black


def pack_light(rgb: np.ndarray, steps: int) -> np.ndarray:
    """Codes (N, 3) int64 of linear light (N, 3) in `steps` an octave; more than the brightest is clamped."""
    rgb = np.clip(np.asarray(rgb, np.float64), 2.0**-1000, 2.0**LOG2_MAX)
    code = np.minimum(np.rint((np.log2(rgb) - LOG2_MIN) * steps).astype(np.int64) + 1, code_max(steps))
    brightest = code.max(axis=1, initial=0, keepdims=True)
    return np.where(code < np.maximum(brightest - DARK * steps, 1), 0, code)


def unpack_light(code: np.ndarray, steps: int) -> np.ndarray:
    """Linear light (N, 3) float32 of codes (N, 3) from 0 to `code_max`."""
    light = powers(code - 1 + LOG2_MIN * steps, steps)
    return np.where(code > 0, light, 0).astype(np.float32)


def code_max(steps: int) -> int:
    """The code of the brightest light."""
    return (LOG2_MAX - LOG2_MIN) * steps


def powers(code: np.ndarray, steps: int) -> np.ndarray:
    """2^(code / steps) as float64, for integers of any shape."""
    octave, part = np.divmod(code, steps)
    table = np.array([2.0 ** (i / steps) for i in range(steps)])
    return np.ldexp(table[part], octave.astype(np.int32))
