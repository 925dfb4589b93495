"""The gradient of what the `surface` operator reads, and its central differences."""

from types import SimpleNamespace

import numpy as np
import oracle
from scipy.spatial.transform import Rotation
from surface_cases import field_of, gaussians, of_type, points

from gsgi.baker.surface.lookup import filling
from gsgi.baker.surface.state import PARAMETERS
from gsgi.runtime.gaussians import SurfaceBlend

BLEND = SurfaceBlend(floor=0.05)  # many points lie above it, and many below
COUNT, STEP = 12, 1e-6


def exactly_moved(given: SimpleNamespace, change: np.ndarray) -> SimpleNamespace:
    """What `moved` does, in double precision and without limits."""
    place, turn, log_scale, logit, colour, slope = np.split(change, np.cumsum(list(PARAMETERS.values()))[:-1], axis=1)
    axes = oracle.rotation_matrix(given.rotation)
    odds = given.opacity / (1 - given.opacity) * np.exp(logit[:, 0])
    sh = given.sh.copy()
    sh[:, 0] += colour
    return SimpleNamespace(
        position=given.position + np.einsum("nij,nj->ni", axes, given.scale * place),
        rotation=(Rotation.from_quat(given.rotation) * Rotation.from_rotvec(turn)).as_quat(),
        scale=given.scale * np.exp(log_scale),
        opacity=odds / (1 + odds),
        sh=sh,
        slope=given.slope + slope[:, : given.slope.shape[1]],
    )


class Problem:
    """Double-precision Gaussians, points that lie near the ends of some, and a smooth loss, sum v . B + |B|^2 / 2.

    A weight ends without a step, but its derivative does not, and B goes below the floor with a kink: points that stand
    within 1e-4 of the end of a Gaussian, of its horizon or of the floor, a hundred times what the differences move, are
    left out.
    """

    def __init__(self, sharpness: int, coefficients: int, sloped: bool):
        given = gaussians(COUNT, coefficients, sloped=sloped)
        given.scale[...] = np.maximum(given.scale, 0.1)
        self.given = of_type(given, np.float64)
        self.given.rotation /= np.linalg.norm(self.given.rotation, axis=1, keepdims=True)  # beyond a float's 24 bits
        position, normal = points(1500, np.float64)
        nearness, cosine = self.nearness(position, normal)
        ends = np.abs(nearness - 0.05)
        clear = (ends.min(axis=1) > 1e-4) & (np.abs(cosine).min(axis=1) > 1e-4)
        weight = field_of(self.given, position, normal, 0.05, sharpness).read(self.given)[:, 3]
        clear &= np.abs(weight - BLEND.floor) > 1e-4
        assert ((weight > 0) & (weight < BLEND.floor))[clear].sum() >= 20
        assert (weight > BLEND.floor)[clear].sum() >= 20
        assert ((nearness > 0.05) & (ends < 2e-3)).any(axis=1)[clear].sum() > 5  # hardly inside
        assert ((nearness < 0.05) & (ends < 2e-3)).any(axis=1)[clear].sum() > 5  # hardly outside
        self.position, self.normal = position[clear], normal[clear]
        rng = np.random.default_rng(5)
        self.values, self.coarse = rng.normal(size=self.position.shape), rng.uniform(1, 2, self.position.shape)
        self.field = field_of(self.given, self.position, self.normal, 0.05, sharpness, 1.1)

    def nearness(self, position, normal) -> tuple[np.ndarray, np.ndarray]:
        """G and cosine (S, COUNT)."""
        axes = oracle.rotation_matrix(self.given.rotation)
        e = np.einsum("snj,nji->sni", position[:, None] - self.given.position, axes) / self.given.scale
        return np.exp(-0.5 * (e**2).sum(axis=2)), normal @ axes[:, :, 2].T

    def light(self, given) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """B, 1 / (sum w + gap), and the light that gives way to a Gaussian which comes to weigh more."""
        fine = self.field.read(given)
        sums = fine + filling(fine, self.coarse, BLEND)
        light = sums[:, :3] / sums[:, 3:]
        return light, 1 / sums[:, 3], np.where(fine[:, 3:] < BLEND.floor, self.coarse, light)

    def loss(self, given) -> float:
        light, *_ = self.light(given)
        return (self.values * light + light**2 / 2).sum()

    def gradient(self) -> np.ndarray:
        light, inverse, yielding = self.light(self.given)
        return self.field.backward(self.given, yielding, self.values + light, inverse)

    def difference(self, index: int, parameter: int) -> float:
        change = np.zeros((COUNT, sum(PARAMETERS.values())))
        change[index, parameter] = STEP
        return (self.loss(exactly_moved(self.given, change)) - self.loss(exactly_moved(self.given, -change))) / 2 / STEP
