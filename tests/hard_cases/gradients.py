"""Derivatives, the steps that follow them, and the solver: at saturation, at zero, and from hostile starts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import oracle
import scenes
import surface_cases
import surface_gradient
import torch
import torch_splat

from gsgi.baker.fitting.target import Target
from gsgi.baker.over.optimiser import CpuOptimiser
from gsgi.baker.over.raw_gaussians import NAMES as RAW
from gsgi.baker.over.raw_gaussians import RawGaussians
from gsgi.baker.over.workspace import AdamState
from gsgi.baker.surface.colours import solve
from gsgi.baker.surface.optimiser import SurfaceOptimiser
from gsgi.baker.surface.state import PARAMETERS as SURFACE_PARAMETERS
from gsgi.baker.surface.state import SurfaceState
from gsgi.runtime.gaussians import Gaussians, OverBlend, SurfaceBlend

from .build import CAMERA, gaussians, joined, turned
from .case import Case, Measured, Tolerance
from .over import EVERYWHERE as OVER
from .over import PARAMETERS, over_case

GROUP = "Gradients"
WITHOUT_FILE = tuple(layer for layer in OVER if layer != "file")
INSIDE = scenes.inside_camera().pinhole(30, 22)
FINITE = {"kernels": Tolerance(0, "numbers are finite or not")}


def over(name: str, build, **question) -> Case:
    return over_case(GROUP, name, build, WITHOUT_FILE, "images and gradients are the twin's", **question)


def measured(name: str, layer: str, measure, tolerance: Tolerance, holds: str, slow: bool = False) -> Case:
    return Case(GROUP, name, holds, lambda: Measured({layer: lambda _: measure()}), {layer: tolerance}, slow=slow)


def at_clamps() -> Gaussians:
    """Opaque ones reach alpha_max and end pixels; others lie beyond the frustum clamp on one axis or both."""
    parts = [gaussians((x, y, -1.0), (0.4, 0.3, 0.2), turned(x + y), 0.9) for x in (-1, 0.9) for y in (0.1, 1, -1.2)]
    parts += [gaussians((0.1 * k, 0, -2 - k), (1, 1, 0.1), turned(k), 1.0, (k + 1, 1, 2)) for k in range(4)]
    return joined(*parts)


def off_every_cut(degree: int) -> Gaussians:
    """No alpha reaches alpha_max, no pixel ends: a round one, a needle, one beyond the clamp, one turned aslant."""
    slanted = np.array([0.5, -0.3, 0.4, 0.7]) / np.linalg.norm([0.5, -0.3, 0.4, 0.7])
    scene = joined(
        gaussians((0.05, 0.1, -1.0), 0.1, opacity=0.5),
        gaussians((-0.1, 0.05, -1.5), (0.4, 0.01, 0.02), turned(np.pi / 4), 0.7, (2, 0.5, 1)),
        gaussians((1.3, 1.1, -1.2), (0.5, 0.6, 0.4), turned(1.0), 0.6, (0.5, 1, 0.2)),
        gaussians((0.1, -0.2, -2.0), (0.3, 0.1, 0.2), slanted, 0.4, (0.3, 2, 1)),
    )
    lobes = 0.2 * np.random.default_rng(1).normal(size=(4, (degree + 1) ** 2 - 1, 3))
    return replace(scene, sh=np.concatenate([scene.sh, lobes], axis=1).astype(np.float32))


class Doubles(SimpleNamespace):
    """Gaussians in double precision, as the oracle reads them."""

    def __len__(self) -> int:
        return len(self.position)


def oracle_differences(degree: int) -> float:
    """The twin's gradient against central differences of the oracle, in parts of each parameter's largest."""
    given, blend = off_every_cut(degree), OverBlend(near=0.01, alpha_min=1e-14)
    pinhole, step = CAMERA.pinhole(12, 10), 1e-5
    weight = np.random.default_rng(2).normal(size=(10, 12, 4))
    tensors = [torch.tensor(getattr(given, name), dtype=torch.float64, requires_grad=True) for name in PARAMETERS]
    image, transmittance = torch_splat.splat(*tensors, pinhole, blend)
    loss = (image * torch.from_numpy(weight[..., :3])).sum() + (transmittance * torch.from_numpy(weight[..., 3])).sum()
    gradients = torch.autograd.grad(loss, tensors)

    def at(arrays: dict[str, np.ndarray]) -> float:
        image, transmittance = oracle.splat(Doubles(**arrays, sh_degree=degree), pinhole, blend)
        return (image * weight[..., :3]).sum() + (transmittance * weight[..., 3]).sum()

    errors = []
    for name, gradient in zip(PARAMETERS, gradients, strict=True):
        arrays = {other: getattr(given, other).astype(float) for other in PARAMETERS}
        flat, expected = arrays[name].reshape(-1), np.zeros(gradient.numel())
        for i in range(len(flat)):
            middle = flat[i]
            flat[i] = middle + step
            above = at(arrays)
            flat[i] = middle - step
            expected[i] = (above - at(arrays)) / (2 * step)
            flat[i] = middle
        assert np.abs(expected).max() > 1e-3, name
        errors.append(np.abs(gradient.numpy().ravel() - expected).max() / np.abs(expected).max())
    return float(max(errors))


def surface_differences(sharpness: int, coefficients: int, sloped: bool) -> float:
    """The kernel's gradient of B against central differences, in parts of the largest."""
    problem = surface_gradient.Problem(sharpness, coefficients, sloped)
    got = problem.gradient()[:, : 15 if sloped else 13]
    expected = np.array([[problem.difference(i, k) for k in range(got.shape[1])] for i in range(len(got))])
    assert (np.abs(expected) > 1e-2).mean() > 0.8
    return float(np.abs(got - expected).max() / np.abs(expected).max())


def hostile_raw() -> RawGaussians:
    """Raw parameters far outside what a fit meets: giants, specks, opaque, invisible, unnormalised, at the eye."""
    rng = np.random.default_rng(0)
    raw = RawGaussians.from_gaussians(oracle.random_gaussians(40, 1, 0))
    raw.log_scale[:20] = rng.uniform(-60, 30, (20, 3))
    raw.logit_opacity[5:25] = rng.uniform(-80, 80, 20)
    raw.rotation[10:15] = 0
    raw.rotation[15:20] *= 1e18
    raw.position[20:30] = scenes.inside_camera().position
    raw.position[30:33] = 1e15
    raw.sh[33:36] = 1e20
    raw.sh[36:40] = 0
    return raw


def hostile_fit(iterations: int) -> float:
    """How many raw parameters of a fit by the `over` operator are not finite after many steps."""
    pinhole, raw = scenes.inside_camera().pinhole(16, 12), hostile_raw()
    optimiser = CpuOptimiser(raw, AdamState.zeros(raw), OverBlend(0.01))
    target = Target.of(np.ones((12, 16, 3), np.float32), np.ones((12, 16), bool), 0.5)
    rates = dict.fromkeys(RAW, 0.05)
    for _ in range(iterations):
        loss = optimiser.iterate(pinhole, target, rates)[0]
        assert np.isfinite(loss)
    return float(sum((~np.isfinite(getattr(optimiser.raw, name))).sum() for name in RAW))


def hostile_surface_fit(iterations: int) -> float:
    """The same with the `surface` operator."""
    given = surface_cases.gaussians(40, 1, sloped=True)
    given.scale[:10] = [1e-12, 1, 1e6]
    given.opacity[10:15], given.opacity[15:20] = 0, 1
    given.position[20:25], given.sh[25:30], given.sh[30:35] = 1e15, 0, 1e10
    given.slope[35:] = 1e3
    position, normal = surface_cases.points(200)
    samples = surface_cases.samples_of(np.ones((200, 3)), position, normal, 0.5)
    optimiser = SurfaceOptimiser(samples, surface_cases.gaussians(3, 9, seed=4), SurfaceBlend())
    state = SurfaceState.fresh(given)
    rates = dict.fromkeys(SURFACE_PARAMETERS, 0.05)
    for step in range(1, iterations + 1):
        with np.errstate(divide="ignore"):  # the logit of an opacity of 1, which is clamped
            state, seen = optimiser.step(state, rates, step)
        assert np.isfinite(seen)
    return float(sum((~np.isfinite(getattr(state.gaussians, name))).sum() for name in surface_cases.FIELDS))


def singular_solve(change, importance: float = 1.0, noise: float = 0.0, ridge: float = 0.0) -> float:
    """How many solved colours and slopes are not finite, after 200 steps on a system without a unique solution."""
    given = surface_cases.gaussians(12, 4, sloped=True)
    change(given)
    position, normal = surface_cases.points(40)
    field = surface_cases.field_of(given, position, normal)
    light, ones = np.ones((40, 3), np.float32), np.ones(40, np.float32)
    arguments = np.zeros((40, 4), np.float32), light, importance * ones, noise * ones
    with np.errstate(over="ignore"):
        return float(sum((~np.isfinite(part)).sum() for part in solve(field, given, *arguments, ridge, 200)))


def coincident(given: Gaussians) -> None:
    for name in surface_cases.FIELDS:
        getattr(given, name)[...] = getattr(given, name)[:1]


def unseen(given: Gaussians) -> None:
    given.position[...] = 1e6


def black(given: Gaussians) -> None:
    given.sh[...] = 0


def singular(name: str, change, **how) -> Case:
    return measured(f"conjugate gradients, {name}", "kernels", lambda: singular_solve(change, **how),
                    FINITE["kernels"], "the solver ends with finite numbers")  # fmt: skip


DIFFERENCES = Tolerance(1e-6, "central differences: 1e-10 of truncation, 1e-16 / 1e-5 of rounding, of sums near 1e3")

CASES = [
    *[over(f"SH of degree {k}", lambda k=k: oracle.random_gaussians(50, k, 20 + k), pinhole=INSIDE) for k in range(4)],
    over("at every clamp", at_clamps),
    over("off every cut", lambda: off_every_cut(3)),
    over("a negative colour", lambda: gaussians(colour=(1, -1, 0))),
    over("saturated at alpha_max", lambda: gaussians(scale=9, opacity=1.0)),
    *[
        measured(f"over: finite differences, SH of degree {k}", "oracle", lambda k=k: oracle_differences(k),
                 DIFFERENCES, "the twin's gradient is the oracle's", slow=k in (1, 2))
        for k in range(4)
    ],
    *[
        measured(f"surface: finite differences, sharpness {s}, {k} coefficients, {'' if sloped else 'no '}slopes",
                 "double", lambda s=s, k=k, sloped=sloped: surface_differences(s, k, sloped),
                 DIFFERENCES, "the kernel's gradient is that of what it reads")
        for s, k, sloped in ((0, 1, False), (1, 9, True), (2, 1, True), (2, 9, False), (5, 9, True))
    ],
    measured("over: 10,000 steps from a hostile start", "kernels", lambda: hostile_fit(10_000), FINITE["kernels"],
             "loss and parameters stay finite"),
    measured("surface: 1,000 steps from a hostile start", "kernels", lambda: hostile_surface_fit(1000),
             FINITE["kernels"], "loss and parameters stay finite"),
    measured("surface: 10,000 steps from a hostile start", "kernels", lambda: hostile_surface_fit(10_000),
             FINITE["kernels"], "loss and parameters stay finite", slow=True),
    singular("twelve coincident Gaussians, no ridge", coincident),
    singular("Gaussians that no sample sees, no ridge", unseen),
    singular("black Gaussians, no ridge", black),
    singular("more unknowns than samples, no ridge", lambda _: None),
    singular("samples that do not count", coincident, importance=0.0),
    singular("importance 1e20 and noise 1e10", coincident, importance=1e20, noise=1e10),
]  # fmt: skip
