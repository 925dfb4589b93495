"""Gaussians as the optimiser steps them: before activation."""

from dataclasses import dataclass

import numpy as np

from gsgi.runtime.gaussians import Gaussians

NAMES = ("position", "rotation", "log_scale", "logit_opacity", "sh")
OPACITY_RANGE = (1e-4, 1 - 1e-4)  # the logit's gradient vanishes outside
SCALE_MIN = 1e-12  # m; keeps the logarithm finite


@dataclass(frozen=True)
class RawGaussians:
    """Parameters of N Gaussians, as float32 C-contiguous arrays that the optimiser changes in place.

    position       (N, 3), m, world space
    rotation       (N, 4), quaternion xyzw of any length except 0
    log_scale      (N, 3), natural logarithm of the standard deviations in m
    logit_opacity  (N,)
    sh             (N, K, 3)
    """

    position: np.ndarray
    rotation: np.ndarray
    log_scale: np.ndarray
    logit_opacity: np.ndarray
    sh: np.ndarray

    def __len__(self) -> int:
        return len(self.position)

    @staticmethod
    def from_gaussians(gaussians: Gaussians) -> "RawGaussians":
        """Raw copies; opacity is clamped to OPACITY_RANGE, and scale is at least SCALE_MIN."""
        g = gaussians
        opacity = np.clip(g.opacity.astype(np.float64), *OPACITY_RANGE)
        log_scale = np.log(np.maximum(g.scale, np.float32(SCALE_MIN)))
        logit = np.log(opacity / (1 - opacity))
        return RawGaussians(
            *(np.array(a, np.float32, order="C") for a in (g.position, g.rotation, log_scale, logit, g.sh))
        )

    def to_gaussians(self) -> Gaussians:
        """Activated copies."""
        length = np.maximum(np.linalg.norm(self.rotation, axis=1, keepdims=True), np.float32(1e-12))
        opacity = (1 / (1 + np.exp(-self.logit_opacity.astype(np.float64)))).astype(np.float32)
        rotation = self.rotation / length
        return Gaussians(self.position.copy(), rotation, np.exp(self.log_scale), opacity, self.sh.copy())

    def zeros_like(self) -> "RawGaussians":
        """Zeros of the same shapes."""
        return RawGaussians(*(np.zeros_like(getattr(self, name)) for name in NAMES))
