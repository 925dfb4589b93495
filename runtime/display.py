"""Convert linear light to display-referred colour: exposure, tone curve, 8 bits."""

import numpy as np

from . import constants

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights for linear Rec.709 (ITU-R BT.709-6)


def luminance(linear: np.ndarray) -> np.ndarray:
    """Luminance (H, W) float64 of linear light (H, W, 3)."""
    return linear.astype(np.float64) @ _LUMINANCE


def auto_exposure(linear: np.ndarray) -> float:
    """Factor that maps the log-average luminance of an image to mid-grey.

    `linear` (H, W, 3) is radiance. Black and non-finite pixels are ignored; if no others exist, the factor is 1.
    Reinhard et al. 2002, "Photographic Tone Reproduction for Digital Images".
    """
    found = luminance(linear)
    lit = found[np.isfinite(found) & (found > 0)]
    return float(constants.MID_GREY / np.exp(np.log(lit).mean())) if lit.size else 1.0


def tone_map(linear: np.ndarray, exposure: float) -> np.ndarray:
    """Convert radiance (H, W, 3) to display-referred sRGB (H, W, 3) float32 in [0, 1].

    Applies Khronos 2024, "Khronos PBR Neutral Tone Mapper", then the sRGB transfer function, like
    glsl/lib/tonemap.glsl. Negative values and NaN become 0; infinity becomes the largest half float.
    """
    color = np.clip(np.nan_to_num(np.asarray(linear, np.float64) * exposure), 0, constants.HALF_MAX)
    return encode_srgb(_neutral(color)).astype(np.float32)


def to_uint8(display: np.ndarray) -> np.ndarray:
    """Convert display-referred values in [0, 1] to uint8, rounded to nearest."""
    return (np.clip(display, 0, 1) * 255 + 0.5).astype(np.uint8)


def _neutral(color: np.ndarray) -> np.ndarray:
    f90 = constants.NEUTRAL_F90
    lowest = color.min(axis=-1, keepdims=True)
    color = color - np.where(lowest < 2 * f90, lowest - lowest**2 / (4 * f90), f90)
    start = constants.NEUTRAL_START - f90
    room = 1 - start
    peak = color.max(axis=-1, keepdims=True)
    bent = np.maximum(peak, start)
    new_peak = 1 - room**2 / (bent + room - start)
    white = 1 - 1 / (constants.NEUTRAL_DESATURATION * (bent - new_peak) + 1)
    compressed = color * (new_peak / bent)
    return np.where(peak < start, color, compressed + (new_peak - compressed) * white)


def encode_srgb(color: np.ndarray) -> np.ndarray:
    """Convert linear values in [0, 1] of any shape to sRGB (IEC 61966-2-1:1999)."""
    high = 1.055 * np.maximum(color, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(color <= 0.0031308, 12.92 * color, high)
