"""The target of the fit: a view of B as the loss sees it, 6 bytes per pixel."""

from dataclasses import dataclass

import numpy as np

INVALID = 65535  # 1, which the tone curve never reaches: the mask needs no array of its own


@dataclass(frozen=True, eq=False)
class Target:
    """B of one view through the tone curve x / (x + tone_scale).

    tone (H, W, 3) uint16, 65535 standing for 1, and in all three channels for a pixel that does not count;
    tone_scale in radiance. The step is 1.5e-5 of white; light up to 65534 tone_scale can be told apart from more.
    """

    tone: np.ndarray
    tone_scale: float

    @classmethod
    def of(cls, indirect: np.ndarray, valid: np.ndarray, tone_scale: float) -> "Target":
        """From B (H, W, 3) float32, linear, and which pixels (H, W) bool count; the others may hold anything.

        Raises ValueError where a pixel that counts is negative or not finite, or where tone_scale is not positive.
        """
        if not tone_scale > 0:
            raise ValueError(f"tone_scale is {tone_scale}, expected more than 0")
        light = np.where(valid[..., None], indirect, np.float32(0))
        broken = ~(np.isfinite(light) & (light >= 0)).all(axis=2)
        if broken.any():
            raise ValueError(f"{np.count_nonzero(broken)} pixels of the target are negative or not finite")
        tone = np.minimum(np.rint(light / (light + np.float32(tone_scale)) * INVALID), INVALID - 1).astype(np.uint16)
        tone[~valid] = INVALID
        return cls(tone, tone_scale)

    @property
    def valid(self) -> np.ndarray:
        """Which pixels count: (H, W) bool."""
        return self.tone[..., 0] != INVALID

    @property
    def indirect(self) -> np.ndarray:
        """B (H, W, 3) float32, linear; 0 where nothing counts."""
        tone = np.where(self.valid[..., None], self.tone, 0).astype(np.float32)
        return tone / (INVALID - tone) * np.float32(self.tone_scale)
