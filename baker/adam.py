"""The Adam optimiser (Kingma and Ba 2015).

Ours, since torch's loads Triton, whose LLVM crashes a process in which Mesa has drawn with its own.
"""

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
