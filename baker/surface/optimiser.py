"""Steps Gaussians of the `surface` operator against many samples at once."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsgi.baker.fitting.rotations import axes
from gsgi.baker.native import kernels
from gsgi.baker.trace.local_light import LocalLight
from gsgi.baker.trace.point_order import coherent
from gsgi.runtime import constants
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from . import colours, relief
from .lookup import coarse_light, filling
from .samples import SurfaceSamples
from .state import PARAMETERS, SurfaceState

# Every LIST_STEPS steps the samples that each Gaussian reaches are listed, and the noise of the gradients is measured.
# The lists are for Gaussians MARGIN times as large, because Gaussians grow and move between two listings. Where they
# stay as they are, EXACT is enough: it covers rounding.
LIST_STEPS, MARGIN, EXACT = 10, 1.1, 1.001

# Adam (Kingma and Ba 2015). Each step uses many samples, so that the second moment needs only a short memory.
BETA_1, BETA_2, EPSILON = 0.9, 0.98, 1e-20

MODEL = 0.1  # error of the best fit, relative to the light around a sample: noise below it costs no weight
ADAPTS = 3.0  # times brighter than the light around a sample is what eyes there adapt to instead
SIZE_COST = 0.05  # of its own error, for a Gaussian e times as long on one axis: prefers the smaller of equal fits
LOGIT_MAX = 5.0  # magnitude, of the opacity


class _Reading(NamedTuple):
    """At each of S samples: B (S, 3), 1 / (sum w + gap) (S,), and the light (S, 3) that yields to a Gaussian whose
    weight grows: B, or below the floor the light of the coarse level."""

    light: np.ndarray
    inverse: np.ndarray
    yielding: np.ndarray


class SurfaceOptimiser:
    """Steps Gaussians by Adam on the mean over the samples of importance |B - light|^2 in linear light.

    The importance is 1 / (level^2 + (noise / MODEL)^2), with the level and noise of the light around each sample (see
    local_light): an error counts relative to what eyes there adapt to, and noisy samples count less. A squared error
    in linear light has its minimum at the mean of noisy samples. Where the Gaussians are more than ADAPTS times as
    bright as the level, the level is taken from them, so that no error counts for more than ADAPTS^2: a bright floor
    that reaches a black void beneath would outweigh all else a million times, and solutions would not converge. That
    depends on no single sample, whose noise it would take for an error. A gradient counts only
    where both halves of the samples' paths agree on its sign (after the AND-mask of Parascandolo et al. 2020), so that
    noise alone moves nothing. Deterministic for any number of threads.

    Where the Gaussians have relief, what it adds at bent normals is taken off the samples whenever they are listed: the
    steps see the light of interpolated normals.
    """

    def __init__(
        self, samples: SurfaceSamples, coarse: Gaussians, blend: SurfaceBlend, around: LocalLight | None = None,
        ridge: float = colours.RIDGE,
    ):  # fmt: skip
        """`around` is the light around the samples; by default that of their neighbours on the same surface. `ridge` is
        how strongly colours are held to a mean (see `colours.RIDGE`)."""
        facing = samples.normal if blend.sharpness else None  # else Gaussians reach points with all normals
        self._order = order = coherent(samples.position, facing)
        around = around or samples.blocks.light(samples.indirect_a, samples.indirect_b)
        samples, around = samples[order], around.at(order)
        self._bent = samples.indirect_a, samples.indirect_b, samples.indirect
        self._a, self._b, self._light = self._bent
        self._bend = samples.bend if samples.bumpy else None
        self._field = kernels.FieldFloat(samples.position, samples.normal, self._bend)
        bent = self._field if self._bend is None else kernels.FieldFloat(samples.position, samples.mapped)
        self._coarse = coarse_light(bent, coarse, blend)
        self.blend = blend
        self._ridge = ridge
        self._level, self._relative_noise = around.level, around.noise / around.level
        self._variance = np.square(around.noise / np.float32(MODEL))
        self._listed, self._margin, self._shape = 0, 0.0, (None,) * 3
        self._noise: np.ndarray | None = None
        self._unit: np.ndarray | None = None
        self._size_cost: np.ndarray | None = None

    def exchanged(self) -> None:
        """List anew before the next step: its Gaussians have changed otherwise than by steps of this optimiser."""
        self._listed = -1

    def solve(
        self, gaussians: Gaussians, iterations: int | None = None, between: bool = False,
        fixed: np.ndarray | None = None,
    ) -> Gaussians:  # fmt: skip
        """Set colours and slopes, then relief if there is any, to the least-squares solution for the shapes.

        With a number of `iterations`, it takes no more for colours and slopes, and leaves relief as it is. `between`
        steps, it reads what was listed for them. Those that are `fixed` (N,) bool keep their light.
        """
        if not between:
            self._list(gaussians)
        fine = self._field.read(gaussians)
        base = filling(fine, self._coarse, self.blend)
        samples = self._light, self._importance(self._reading(fine).light), self._relative_noise
        most = colours.MOST if iterations is None else iterations
        sh, slope = colours.solve(self._field, gaussians, base, *samples, self._ridge, most, fixed)
        solved = replace(gaussians, sh=sh, slope=slope)
        return self._with_relief(solved) if self._bent_by(gaussians) and iterations is None else solved

    def _bent_by(self, gaussians: Gaussians) -> bool:
        """Whether relief adds light anywhere: of samples of which a part is bumpy, another may be flat."""
        return gaussians.bumpy and self._bend is not None

    def _with_relief(self, gaussians: Gaussians) -> Gaussians:
        reading = self._read(gaussians)
        residual = self._bent[2] - reading.light
        weights = reading.inverse, self._importance(reading.light)
        found = relief.solve(self._field, gaussians, self._bend, residual, *weights)
        return replace(gaussians, relief=found)

    def share(self, gaussians: Gaussians) -> np.ndarray:
        """Number of samples (N,) float32 that each Gaussian accounts for: the sum over the samples of w / sum w."""
        self._list(gaussians)
        light, inverse, _ = self._read(gaussians)
        return self._seen(gaussians, np.ones_like(light), inverse)[:, 0]

    def error(self, gaussians: Gaussians) -> np.ndarray:
        """Noise-free error (S,) of each sample, in the order of the samples."""
        self._list(gaussians)
        found = self._error(self._read(gaussians).light)
        error = np.empty_like(found)
        error[self._order] = found
        return error

    def gain(self, gaussians: Gaussians, others: Gaussians) -> np.ndarray:
        """By how much (N,) float32 the mean error of the samples that each Gaussian accounts for falls with `others`.

        It is -inf where there is none.
        """
        lights = []
        for some in (others, gaussians):
            self._list(some)
            lights.append((reading := self._read(some)).light)
        after, before = (self._error(light) for light in lights)
        return self._mean(gaussians, before - after, reading.inverse, -np.inf)[:, 0]

    def level_of(self, gaussians: Gaussians) -> np.ndarray:
        """Mean level (N, 1) around the samples that each Gaussian accounts for; 0 where there is none."""
        self._list(gaussians)
        return self._level_of(gaussians, self._read(gaussians).inverse)

    def step(self, state: SurfaceState, rates: Mapping[str, float], steps: int) -> tuple[SurfaceState, float]:
        """Take one step of Adam, the `steps`-th since the start (from 1); the state after it, and the loss before.

        Raises FloatingPointError where the loss or a gradient is not finite, and names the Gaussian of the gradient.
        The step depends on the listing of an earlier step, unless `steps` - 1 is a multiple of LIST_STEPS.
        """
        if (steps - 1) % LIST_STEPS == 0 or self._listed != len(state):
            self._list(state.gaussians, MARGIN)
        elif self._margin < MARGIN:
            self._reach(state.gaussians, MARGIN)
        reading = self._read(state.gaussians)
        gradient, loss = self._derivatives(state.gaussians, reading)
        if len(broken := np.flatnonzero(~np.isfinite(gradient).all(axis=1))):
            raise FloatingPointError(f"the gradient of Gaussian {broken[0]} is not finite")
        if not np.isfinite(loss):
            raise FloatingPointError(f"the loss is {loss}")
        if self._noise is None:
            self._noise = self._gradient_noise(state.gaussians, reading)
            self._unit = self._level_of(state.gaussians, reading.inverse)
            self._size_cost = SIZE_COST * self._own_error(state.gaussians, reading)
        gradient[:, 6:9] += self._size_cost
        gradient[np.abs(gradient) <= self._noise] = 0
        rate = np.repeat([rates[name] for name in PARAMETERS], list(PARAMETERS.values()))
        mean = BETA_1 * state.mean + np.float32(1 - BETA_1) * gradient
        square = BETA_2 * state.square + np.float32(1 - BETA_2) * gradient**2
        change = -rate * (mean / (1 - BETA_1**steps)) / (np.sqrt(square / (1 - BETA_2**steps)) + EPSILON)
        stepped = moved(state.gaussians, change, self._unit, state.smallest, state.largest)
        return replace(state, gaussians=stepped, mean=mean.astype(np.float32), square=square.astype(np.float32)), loss

    def _level_of(self, gaussians: Gaussians, inverse: np.ndarray) -> np.ndarray:
        return self._mean(gaussians, self._level, inverse, 0)

    def _mean(self, gaussians: Gaussians, values: np.ndarray, inverse: np.ndarray, none: float) -> np.ndarray:
        """Mean (N, 1) of values (S,) over the samples that each Gaussian accounts for; `none` where there are none."""
        ones = np.ones_like(values)
        sums = self._seen(gaussians, np.stack([values, ones, ones], axis=1), inverse)
        return np.divide(sums[:, :1], sums[:, 1:2], out=np.full_like(sums[:, :1], none), where=sums[:, 1:2] > 0)

    def _own_error(self, gaussians: Gaussians, reading: _Reading) -> np.ndarray:
        """The part (N, 1) of the noise-free error that each Gaussian accounts for, 0 where noise makes it negative.

        Equal shares of the scene's error instead would shrink all Gaussians for what few of them fit badly, until
        surfaces that are fitted well are bare.
        """
        error = np.repeat(self._error(reading.light)[:, None], 3, axis=1)
        return np.maximum(self._seen(gaussians, error, reading.inverse)[:, :1], 0) / max(len(error), 1)

    def _seen(self, gaussians: Gaussians, values: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Sums (N, 3) of w / sum w times values (S, 3) over the samples."""
        constant = replace(gaussians, sh=gaussians.sh[:, :1].copy(), slope=None)
        return self._field.transposed(constant, values, inverse) / np.float32(constants.SH_C0)

    def _reach(self, gaussians: Gaussians, margin: float) -> None:
        """List the samples that Gaussians `margin` times as large reach. The more is listed, the longer readings take,
        but they do not change."""
        shape = gaussians.position, gaussians.rotation, gaussians.scale
        if margin != self._margin or any(one is not other for one, other in zip(shape, self._shape, strict=True)):
            self._field.list(gaussians, self.blend.cutoff, self.blend.sharpness, margin)
            self._shape, self._margin = shape, margin

    def _list(self, gaussians: Gaussians, margin: float = EXACT) -> None:
        self._reach(gaussians, margin)
        self._listed, self._noise = len(gaussians), None
        if self._bent_by(gaussians):
            added = self._field.read(gaussians, relief=True)[:, :3] * self._read(gaussians).inverse[:, None]
            self._a, self._b, self._light = (light - added for light in self._bent)

    def _read(self, gaussians: Gaussians) -> _Reading:
        return self._reading(self._field.read(gaussians))

    def _reading(self, fine: np.ndarray) -> _Reading:
        """What the sums (S, 4) of the fine level come to."""
        return _Reading(*kernels.fill_gap(fine, self._coarse, self.blend.floor))

    def _derivatives(self, gaussians: Gaussians, reading: _Reading) -> tuple[np.ndarray, float]:
        """The derivatives (N, 15) (see FIELD_DERIVATIVES), and the loss."""
        return self._backward(gaussians, reading, reading.light - self._light)

    def _importance(self, light: np.ndarray) -> np.ndarray:
        """The importance (S,) float32 of errors at the samples, read as light (S, 3)."""
        return kernels.importance(light, self._level, self._variance, ADAPTS)

    def _error(self, light: np.ndarray) -> np.ndarray:
        """Noise-free error (S,) of light (S, 3), which is below 0 where the noise of both halves happens to agree."""
        return self._importance(light) * _channels((light - self._a) * (light - self._b))

    def _gradient_noise(self, gaussians: Gaussians, reading: _Reading) -> np.ndarray:
        """Absolute half difference (N, 15) of the halves' gradients: their signs agree where the gradient is larger."""
        return np.abs(self._backward(gaussians, reading, (self._a - self._b) / 2)[0])

    def _backward(self, gaussians: Gaussians, reading: _Reading, residual: np.ndarray) -> tuple[np.ndarray, float]:
        """The derivatives (N, 15) of the loss with residuals (S, 3), and that loss."""
        by_light, loss = kernels.weigh(self._importance(reading.light), residual)
        return self._field.backward(gaussians, reading.yielding, by_light, reading.inverse), loss


def _channels(values: np.ndarray) -> np.ndarray:
    """The sum (S,) over three channels (S, 3), three times as fast as numpy's."""
    return values[:, 0] + values[:, 1] + values[:, 2]


def moved(
    gaussians: Gaussians, change: np.ndarray, unit: np.ndarray, smallest: np.ndarray, largest: np.ndarray
) -> Gaussians:
    """Apply a change (N, 15) of PARAMETERS, with colour in units of `unit` (N, 1), radiance.

    Constant SH coefficients stay at 0 or more, standard deviations between `smallest` and `largest` (N, 3), and slopes
    within their bound.
    """
    from scipy.spatial.transform import Rotation

    g = gaussians
    place, turn, log_scale, logit, colour, slope = np.split(change, np.cumsum(list(PARAMETERS.values()))[:-1], axis=1)
    position = g.position + (axes(g.rotation) * (g.scale * place)[:, None, :]).sum(axis=2)
    rotation = (Rotation.from_quat(g.rotation) * Rotation.from_rotvec(turn)).as_quat().reshape(-1, 4)
    opacity = g.opacity.astype(np.float64)
    with np.errstate(divide="ignore"):  # an opacity that was stored, before an edit, may be 0 or 1
        odds = np.clip(np.log(opacity / (1 - opacity)) + logit[:, 0], -LOGIT_MAX, LOGIT_MAX)
    arrays = (
        position,
        rotation,
        np.clip(g.scale * np.exp(log_scale), smallest, largest),
        1 / (1 + np.exp(-odds)),
        np.concatenate(
            [np.maximum(g.sh[:, :1] + (unit / constants.SH_C0 * colour)[:, None, :], 0), g.sh[:, 1:]], axis=1
        ),
        colours.bounded_slope(g.slope + slope[:, : g.slope.shape[1]]),
        g.relief,
    )
    return Gaussians(*(array.astype(np.float32) for array in arrays))
