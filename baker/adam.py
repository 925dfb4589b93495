"""The Adam optimiser (Kingma and Ba 2015).

Ours, since torch's loads Triton, whose LLVM crashes a process in which Mesa has drawn with its own.
"""

import numpy as np
import torch
from torch import Tensor

BETA1, BETA2 = 0.9, 0.999
EPSILON = 1e-15  # far below any gradient of a mean over pixels, as Kerbl et al. 2023


class Adam:
    """Steps named tensors, each at its own rate, against their gradients."""

    def __init__(self, parameters: dict[str, Tensor], rates: dict[str, float]):
        self.parameters, self.rates = parameters, rates
        self.mean = {name: torch.zeros_like(tensor) for name, tensor in parameters.items()}
        self.square = {name: torch.zeros_like(tensor) for name, tensor in parameters.items()}
        self.steps = 0

    def state(self) -> dict[str, np.ndarray]:
        """All that the next step depends on: the parameters, both moments and the number of steps, as copies."""
        groups = {"value": self.parameters, "mean": self.mean, "square": self.square}
        arrays = {f"{kind}.{name}": tensor.detach().numpy().copy() for kind, group in groups.items()
                  for name, tensor in group.items()}  # fmt: skip
        return arrays | {"steps": np.array(self.steps)}

    @torch.no_grad()
    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go back to where `state` was taken."""
        for kind, group in (("value", self.parameters), ("mean", self.mean), ("square", self.square)):
            for name, tensor in group.items():
                tensor.copy_(torch.from_numpy(state[f"{kind}.{name}"]))
        self.steps = int(state["steps"])

    @torch.no_grad()
    def step(self, factor: float = 1.0) -> None:
        """One step at `factor` times the rates; then the gradients are cleared."""
        self.steps += 1
        bias1, bias2 = 1 - BETA1**self.steps, 1 - BETA2**self.steps
        for name, tensor in self.parameters.items():
            mean, square = self.mean[name], self.square[name]
            mean.lerp_(tensor.grad, 1 - BETA1)
            square.mul_(BETA2).addcmul_(tensor.grad, tensor.grad, value=1 - BETA2)
            root = square.sqrt().div_(bias2**0.5).add_(EPSILON)
            tensor.addcdiv_(mean, root, value=-factor * self.rates[name] / bias1)
            tensor.grad = None
