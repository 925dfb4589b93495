"""Our Adam against torch's."""

import subprocess
import sys

import pytest
import torch

from gsgi.baker.adam import EPSILON, Adam

TORCH_ADAM = """
import torch
p = torch.linspace(-1, 1, 7, dtype=torch.float64).requires_grad_()
adam = torch.optim.Adam([p], lr=0.03, eps={epsilon})
for _ in range(50):
    adam.zero_grad()
    ((p - 0.3) ** 4).sum().backward()
    adam.step()
print(*p.tolist())
"""


def test_steps_equal_torchs():
    p = torch.linspace(-1, 1, 7, dtype=torch.float64).requires_grad_()
    adam = Adam({"p": p}, {"p": 0.03})
    for _ in range(50):
        ((p - 0.3) ** 4).sum().backward()
        adam.step()
        assert p.grad is None
    # In a child process: see adam.py.
    code = TORCH_ADAM.format(epsilon=EPSILON)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert p.tolist() == pytest.approx([float(x) for x in run.stdout.split()], rel=1e-9)


def test_a_factor_scales_the_step():
    a, b = (torch.ones(3).requires_grad_() for _ in range(2))
    for p, factor in ((a, 1.0), (b, 0.5)):
        adam = Adam({"p": p}, {"p": 0.1})
        p.sum().backward()
        adam.step(factor)
    torch.testing.assert_close(1 - a, 2 * (1 - b))
