"""Images of the `over` operator, and the layers that draw them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import moderngl
import numpy as np
import oracle
import torch
import torch_kernel_splat
import torch_splat

from gsgi.baker.native import kernels
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.constants import ALPHA_MIN, HALF_MAX, SH_C0
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend

from .build import PINHOLE
from .case import Case, Tolerance
from .layers import ALL_SETS, drawn_by_gl, instruction_set
from .stored import stored_error

BLEND = OverBlend(near=0.01)
PARAMETERS = "position", "rotation", "scale", "opacity", "sh"

_DOUBLE = Tolerance(1e-12, "double precision, and the digits that a needle's direction costs")
_FLOAT = Tolerance(1e-5, "float32: some 1e-6 from exp and from the place in the tile")
_GL = Tolerance(ALPHA_MIN, "one contribution of alpha_min, where float32 decides otherwise")
TOLERANCES = {
    "oracle": Tolerance(1e-6, "float32 parameters"),
    "torch": _DOUBLE,
    "double": _DOUBLE,
    **dict.fromkeys(ALL_SETS, _FLOAT),
    "llvmpipe": _GL,
    "gradient, double": Tolerance(1e-9, "double precision, over sums of both signs"),
    "gradient, float": Tolerance(1e-4, "float32: 1e-6, over sums of both signs"),
    "file": Tolerance(1.001, "the worst that the format allows, and float32's rounding of what is read"),
}
EVERYWHERE = tuple(TOLERANCES)


@dataclass(frozen=True)
class OverImage:
    """Image (H, W, 3) and transmittance (H, W) of Gaussians.

    The truth is the oracle's, of `alike` if those are fewer Gaussians with the same image. The oracle itself is held to
    `known`: the light (3,) of every pixel, where that is known.
    """

    gaussians: Gaussians
    pinhole: Pinhole = PINHOLE
    blend: OverBlend = BLEND
    known: tuple[float, float, float] | None = None
    alike: Gaussians | None = None

    @cached_property
    def expected(self) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(over="ignore"):  # footprints beyond what double holds are dropped
            return oracle.splat(self.alike or self.gaussians, self.pinhole, self.blend)

    @cached_property
    def brightest(self) -> float:
        return float(oracle.colour(self.gaussians, self.pinhole).max(initial=0)) or 1.0

    @cached_property
    def expected_gradient(self) -> list[np.ndarray]:
        """Of a fixed random linear function of image and transmittance, by each parameter, by the twin's autograd."""
        return self._gradient(torch_splat.splat, torch.float64)

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The largest difference in transmittance, or in light, in parts of the brightest Gaussian's.

        Of a gradient: see _gradient_error().
        """
        if layer == "file":
            return stored_error(Bake(self.gaussians, self.blend))
        if layer.startswith("gradient"):
            found = self._gradient(torch_kernel_splat.splat, torch.float64 if "double" in layer else torch.float32)
            return self._gradient_error(found)
        if layer == "oracle":
            image, transmittance = self.expected
            assert image.min(initial=0) >= 0
            assert image.max(initial=0) <= self.brightest * (1 + 1e-6)
            assert ((transmittance >= 0) & (transmittance <= 1)).all()
            return 0.0 if self.known is None else float(np.abs(image - self.known).max() / self.brightest)
        expected, brightest = (self.expected, self.brightest)
        if layer in ("llvmpipe", "softpipe") and self.brightest > HALF_MAX:
            capped = replace(self, gaussians=_capped(self.gaussians))
            expected, brightest = capped.expected, capped.brightest
        image, transmittance = self._drawn(layer, gl)
        assert np.isfinite(image).all()
        assert np.isfinite(transmittance).all()
        light = np.abs(image - expected[0]).max(initial=0) / brightest
        return float(max(light, np.abs(transmittance - expected[1]).max(initial=0)))

    def _drawn(self, layer: str, gl: moderngl.Context | None) -> tuple[np.ndarray, np.ndarray]:
        if layer in ("llvmpipe", "softpipe"):
            return self._by_gl(gl)
        if layer == "torch":
            tensors = (torch.tensor(getattr(self.gaussians, name), dtype=torch.float64) for name in PARAMETERS)
            return tuple(t.numpy() for t in torch_splat.splat(*tensors, self.pinhole, self.blend))
        if layer == "double":
            return self._by_kernel(np.float64)
        with instruction_set(layer):
            return self._by_kernel(np.float32)

    def _gradient(self, splat, dtype: torch.dtype) -> list[np.ndarray]:
        parameters = [
            torch.tensor(getattr(self.gaussians, name), dtype=dtype, requires_grad=True) for name in PARAMETERS
        ]
        image, transmittance = splat(*parameters, self.pinhole, self.blend)
        weight = torch.randn(*transmittance.shape, 4, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
        loss = (image * weight[..., :3]).sum() + (transmittance * weight[..., 3]).sum()
        return [gradient.double().numpy() for gradient in torch.autograd.grad(loss, parameters)]

    def _gradient_error(self, found: list[np.ndarray]) -> float:
        """The largest difference of a parameter, in parts of its largest value or of a thousandth of all parameters'.

        All are taken by changes of like size: of position by a deviation, of scale and colour by their own size.
        """
        g = self.gaussians
        extent = g.scale.astype(float).max(axis=1, initial=0, keepdims=True)
        units = extent, np.ones((len(g), 1)), g.scale.astype(float), np.ones(len(g)), float(np.abs(g.sh).max(initial=0))
        assert all(np.isfinite(part).all() for part in found)
        expected = [unit * part for unit, part in zip(units, self.expected_gradient, strict=True)]
        sizes = [np.abs(part).max(initial=0) for part in expected]
        parts = zip(units, found, expected, sizes, strict=True)
        errors = [np.abs(u * f - e).max(initial=0) / (max(size, 1e-3 * max(sizes)) or 1) for u, f, e, size in parts]
        return float(max(errors))

    def _by_kernel(self, dtype) -> tuple[np.ndarray, np.ndarray]:
        arrays = (getattr(self.gaussians, name).astype(dtype) for name in PARAMETERS)
        image, transmittance, _ = kernels.splat(*arrays, self.pinhole, self.blend)
        return image.astype(float), transmittance.astype(float)

    def _by_gl(self, gl: moderngl.Context) -> tuple[np.ndarray, np.ndarray]:
        shape = self.pinhole.height, self.pinhole.width  # the operator reads no surfaces
        near = max(self.blend.near, 1e-3)
        texels = drawn_by_gl(
            gl, Bake(self.gaussians, self.blend), self.pinhole, near, np.ones(shape), np.ones((*shape, 3))
        )
        return texels[..., :3], 1 - texels[..., 3]


def _capped(given: Gaussians) -> Gaussians:
    """As OpenGL draws them: a colour is at most what half floats hold. Of degree 0."""
    assert given.sh_degree == 0
    return replace(given, sh=np.minimum(given.sh, np.float32(HALF_MAX / SH_C0)))


def over_case(
    group: str, name: str, build, layers: tuple[str, ...] = EVERYWHERE,
    holds: str = "the oracle's image", tolerances: Mapping[str, Tolerance] | None = None,
    refused: tuple[type[Exception], str] | None = None, **question,
) -> Case:  # fmt: skip
    """A case of the image of what `build()` returns, Gaussians; `question` goes to OverImage."""
    chosen = {layer: _GL if layer == "softpipe" else TOLERANCES[layer] for layer in layers} | (tolerances or {})
    return Case(group, f"over: {name}", holds, lambda: OverImage(build(), **question), chosen, refused)
