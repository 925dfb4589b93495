"""The target of the fit: a view of B after the loss's tone curve, 6 bytes per pixel."""

from dataclasses import dataclass

import numpy as np

INVALID = 65535  # tone 1, which the curve never reaches: the mask needs no array of its own


@dataclass(frozen=True, eq=False)
class Target:
    """B of one view after the tone curve x / (x + tone_scale).

    tone is (H, W, 3) uint16, where 65535 means 1; a pixel that does not count has 65535 in all three channels.
    tone_scale is in radiance. The quantisation step is 1.5e-5 of white; light above 65534 tone_scale is clipped.
    """

    tone: np.ndarray
    tone_scale: float

    @classmethod
    def of(cls, indirect: np.ndarray, valid: np.ndarray, tone_scale: float) -> "Target":
        """Make a target from B (H, W, 3) float32, linear. `valid` (H, W) bool marks the pixels that count.

        The other pixels can hold anything. Raises ValueError if a pixel that counts is negative or not finite, or if
        tone_scale is not positive.
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
        """Mask (H, W) bool of the pixels that count."""
        return self.tone[..., 0] != INVALID

    @property
    def indirect(self) -> np.ndarray:
        """B (H, W, 3) float32, linear; 0 at pixels that do not count."""
        tone = np.where(self.valid[..., None], self.tone, 0).astype(np.float32)
        return tone / (INVALID - tone) * np.float32(self.tone_scale)
