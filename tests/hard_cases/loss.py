"""The loss of the fit, and the search for a budget: constant, black and tiny images, and targets out of reach."""

from dataclasses import dataclass
from functools import cached_property

import moderngl
import numpy as np
import torch

from gsgi.baker.budget_search import FEWEST, Attempt, search
from gsgi.baker.fitting.loss import image_loss
from gsgi.baker.fitting.target import Target
from gsgi.baker.over import cuda_loss
from gsgi.baker.settings import Settings
from gsgi.runtime.errors import UsageError

from .case import Case, Measured, Tolerance
from .layers import ALL_SETS, instruction_set

GROUP = "Loss and budget"
SCALE = 0.5
TOLERANCES = {
    "double": Tolerance(1e-12, "double precision"),
    **dict.fromkeys(
        ALL_SETS, Tolerance(2.7e-4, "float32: 2^-22 of a mean over C2 = 9e-4, in a window without contrast")
    ),
}


@dataclass(frozen=True)
class ImageLoss:
    """The loss of an image (H, W, 3) that should show `light`, in pixels that are `valid` (H, W). Truth is torch's."""

    image: np.ndarray
    light: np.ndarray
    valid: np.ndarray | None = None

    @cached_property
    def target(self) -> Target:
        valid = np.ones(self.light.shape[:2], bool) if self.valid is None else self.valid
        return Target.of(self.light.astype(np.float32), valid, SCALE)

    @cached_property
    def expected(self) -> tuple[float, np.ndarray]:
        """Value and gradient in double, of the image that float32 holds."""
        x = torch.from_numpy(self.image.astype(np.float32).astype(np.float64)).requires_grad_()
        tone, valid = torch.from_numpy(self.target.tone / 65535), torch.from_numpy(self.target.valid)
        value = cuda_loss.image_loss(x, tone, valid, SCALE)
        value.backward()
        return value.item(), x.grad.numpy()

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The largest difference of the value, or of the gradient in parts of its largest."""
        image = self.image.astype(np.float32)
        if layer == "double":
            found = image_loss(image.astype(np.float64), self.target)
        else:
            with instruction_set(layer):
                found = image_loss(image, self.target)
        assert np.isfinite(found.by_image).all()
        assert np.isfinite(found.error).all()
        value, gradient = self.expected
        size = np.abs(gradient).max(initial=0) or 1
        return float(max(abs(found.value - value), np.abs(found.by_image - gradient).max(initial=0) / size))


def loss(name: str, build) -> Case:
    """A case of the loss of the image, light and validity that `build()` returns."""
    return Case(GROUP, name, "value and gradient are torch's", lambda: ImageLoss(*build()), TOLERANCES)


def noise(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).gamma(1, 0.5, (*shape, 3))


def constant(value: float, *shape: int) -> np.ndarray:
    return np.full((*shape, 3), value)


def half_valid(*shape: int) -> np.ndarray:
    return np.arange(shape[1])[None] < np.full((shape[0], 1), shape[1] // 2)


def searched(target: float, most: int, loss) -> tuple[Attempt, int]:
    tries = []

    def attempt(budget: int) -> Attempt:
        tries.append(budget)
        return Attempt(budget, bytes(4), budget, loss(budget), 0.0, 0.0)

    chosen, _ = search(target, most, attempt)
    assert len(tries) < 40, "the search ends"
    return chosen, max(tries)


def budget(name: str, holds: str, target: float, most: int, expected: int, loss=lambda n: n**-0.5) -> Case:
    def wrong() -> float:
        chosen, largest = searched(target, most, loss)
        assert largest <= most
        return float(abs(chosen.budget - expected))

    return Case(GROUP, name, holds, lambda: Measured({"search": lambda _: wrong()}),
                {"search": Tolerance(0, "a budget is chosen or not")})  # fmt: skip


CASES = [
    loss("constant images", lambda: (constant(0.3, 24, 30), constant(0.5, 24, 30))),
    loss("black images", lambda: (constant(0, 24, 30), constant(0, 24, 30))),
    loss("a black image of a lit view", lambda: (constant(0, 24, 30), noise(24, 30))),
    loss("a lit image of a black view", lambda: (noise(24, 30), constant(0, 24, 30))),
    loss("11 x 11 pixels, one window", lambda: (noise(11, 11), noise(11, 11, seed=1))),
    loss("10 x 40 pixels, no window", lambda: (noise(10, 40), noise(10, 40, seed=1))),
    loss("one pixel", lambda: (noise(1, 1), noise(1, 1, seed=1))),
    loss("light of 1e-6", lambda: (1e-6 * noise(24, 30), 1e-6 * noise(24, 30, seed=1))),
    loss("light of 1e6", lambda: (1e6 * noise(24, 30), 1e6 * noise(24, 30, seed=1))),
    loss("a view that sees a surface in one half", lambda: (noise(24, 30), noise(24, 30, seed=1), half_valid(24, 30))),
    loss("a view that sees nothing", lambda: (noise(24, 30), noise(24, 30), np.zeros((24, 30), bool))),
    budget("a target below what is reachable", "the best there is", 1e-9, 40 * FEWEST, 40 * FEWEST),
    budget("a target exactly at the bound", "the fewest that meet it", FEWEST**-0.5, 40 * FEWEST, FEWEST),
    Case(GROUP, "a most of no Gaussian", "refused: there is no such file",
         lambda: Measured({"search": lambda _: Settings(budget=0)}), {"search": Tolerance(0, "it is refused or not")},
         (UsageError, "^budget: expected at least 1, got 0")),
    budget("a most of one Gaussian", "it is tried", 1e-9, 1, 1),
    budget("a most of two Gaussians", "they are tried", 1e-9, 2, 2),
    budget("a loss that never falls", "the fewest", 1e-9, 40 * FEWEST, FEWEST, lambda _: 0.5),
]  # fmt: skip
