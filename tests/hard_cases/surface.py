"""Light of the `surface` operator at points, and the layers that read it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import SimpleNamespace

import glsl_lookup
import moderngl
import numpy as np
import oracle
from c_library import Library, build
from repository import ROOT

from gsgi.baker.native import kernels
from gsgi.baker.surface.lookup import inverse_weight, light_of, look_up
from gsgi.runtime import sampling
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.constants import HALF_MAX
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend

from .build import NAMES, PINHOLE, nobody
from .case import Case, Tolerance
from .layers import ALL_SETS, drawn_by_gl, instruction_set
from .stored import stored_error

BLEND = SurfaceBlend()
DISTANCE = 2.0  # m; of the wall that the points are on, by default
NEAR = 0.01
CLEAR = 1e-6  # of the largest weight; less is next to nothing, and so are its digits: the mean is anything in between

_FLOAT = Tolerance(1e-5, "float32: 1e-7 of a weight, over the floor of 0.05, times a few Gaussians")
_HALF = Tolerance(1e-3, "B is stored in half floats, of 11 bits; weights are float32")
TOLERANCES = {
    "oracle": Tolerance(1e-6, "float32 parameters"),
    "double": Tolerance(1e-6, "1e-12 of a weight, by exp2, over the smallest that counts, 1e-6"),
    **dict.fromkeys(ALL_SETS, _FLOAT),
    "llvmpipe": _HALF,
    **dict.fromkeys(("C", "sample", "look-up"), Tolerance(1e-5, "float32, as the kernels; cells leave nobody out")),
    "gradient, float": Tolerance(1e-4, "float32 against double: 1e-6, over sums of both signs"),
    "file": Tolerance(1.001, "the worst that the format allows, and float32's rounding of what is read"),
}
EVERYWHERE = tuple(TOLERANCES)
IN_FLOATS = *ALL_SETS, "C", "look-up"  # layers that are given points as float32 holds them in world space


@dataclass(frozen=True)
class Reading:
    """B (H, W, 3) at the points that a camera sees, of which there is one in each pixel.

    `depth` (H, W) float32, m, and `normal` (H, W, 3) say where they are; a wall before the camera by default. The truth
    is the oracle's at the very points that a layer is given: OpenGL has them relative to the bake, the kernels in world
    space, rounded to float32. It is that of `alike` if those are fewer fine Gaussians with the same B. The oracle
    itself is held to `known`, B (3,) of every point, where that is known.
    """

    fine: Gaussians
    coarse: Gaussians
    blend: SurfaceBlend = BLEND
    pinhole: Pinhole = PINHOLE
    depth: np.ndarray | None = None
    normal: np.ndarray | None = None
    known: tuple[float, float, float] | None = None
    alike: Gaussians | None = None
    is_stored: bool = False  # whether the Gaussians are those of a file

    @property
    def bake(self) -> Bake:
        return Bake(self.fine, self.blend, coarse=self.coarse)

    @cached_property
    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth (H, W) float32 and normal (H, W, 3) float32."""
        shape = self.pinhole.height, self.pinhole.width
        depth = np.full(shape, DISTANCE) if self.depth is None else np.broadcast_to(self.depth, shape)
        normal = np.broadcast_to([0, 0, 1] if self.normal is None else self.normal, (*shape, 3))
        return depth.astype(np.float32), normal.astype(np.float32)

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """World-space positions (S, 3) float64 and unit normals (S, 3) float64."""
        p, (depth, normal) = self.pinhole, self.seen
        column, row = np.meshgrid(np.arange(p.width) + 0.5, np.arange(p.height) + 0.5)
        ray = np.stack([(column - p.cx) / p.fx, (p.cy - row) / p.fy, -np.ones_like(row)], axis=-1)
        view = (ray * depth[..., None]).reshape(-1, 3)
        pose = np.linalg.inv(p.view_from_world)
        return view @ pose[:3, :3].T + pose[:3, 3], normal.reshape(-1, 3).astype(float)

    @cached_property
    def expected(self) -> tuple[np.ndarray, np.ndarray]:
        """B (S, 3) at the points, and whether it has digits (S,)."""
        return self._expected(self.points[0])

    @cached_property
    def expected_in_floats(self) -> tuple[np.ndarray, np.ndarray]:
        """The same at the points that float32 holds in world space."""
        return self._expected(self.points[0].astype(np.float32).astype(float))

    @cached_property
    def stored(self) -> "Reading":
        """The same of what a file keeps."""
        bake = codec.decode(codec.encode(self.bake))
        return replace(
            self, fine=bake.gaussians, coarse=bake.coarse, blend=bake.blend, known=None, alike=None, is_stored=True
        )

    def _expected(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        fine = self.alike or self.fine
        with np.errstate(over="ignore"):  # points too far away for their distance to be squared have no weight
            sums, light = oracle.read_surface(fine, self.coarse, self.blend, position, self.points[1])
        weight = sums[..., 3]
        (fine_counts, coarse_counts) = (weight == 0) | (weight > CLEAR * weight.max(axis=1, keepdims=True))
        lacking = weight[0] < self.blend.floor
        return light, np.where(lacking, coarse_counts & ((weight[1] > 0) | fine_counts), True)

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The largest error of B at points where it has digits, in parts of the largest B."""
        if layer == "file":
            return stored_error(self.bake)
        if layer == "gradient, float":
            return self._gradient_error()
        if layer == "C" and not self.is_stored:
            return self.stored.error(layer, gl)
        expected, clear = self.expected_in_floats if layer in IN_FLOATS else self.expected
        assert clear.mean() > 0.5, clear.mean()
        assert np.isfinite(expected).all()
        if layer == "oracle":
            found = expected if self.known is None else np.broadcast_to(self.known, expected.shape)
        else:
            found = LAYERS[layer](self, gl)
        assert np.isfinite(found).all()
        assert (found >= 0).all()
        if layer not in (*ALL_SETS, "oracle", "double"):
            expected = np.minimum(expected, HALF_MAX)
        brightest = float(expected.max(initial=0)) or 1.0
        return float(np.abs(found - expected)[clear].max(initial=0) / brightest)

    def by_kernel(self) -> np.ndarray:
        """In double, by the steps of `look_up`, which is float32 alone."""
        return light_of(self._sums(kernels.FieldDouble, float)[2])

    def _sums(self, kind, dtype, in_floats: bool = False) -> tuple:
        """A field that has listed the fine level, that level, and both levels' sums (S, 4)."""
        points = (array.astype(np.float32) if in_floats else array for array in self.points)
        field = kind(*(np.ascontiguousarray(array, dtype) for array in points))
        sums = []
        for level, sharpness in ((self.coarse, 0), (self.fine, self.blend.sharpness)):
            typed = SimpleNamespace(**{name: getattr(level, name).astype(dtype) for name in NAMES})
            field.list(typed, self.blend.cutoff, sharpness, 1.0)
            sums.append(field.read(typed))
        coarse, fine = sums
        gap = np.maximum(dtype(self.blend.floor) - fine[:, 3:], 0)
        light = coarse[:, :3] * inverse_weight(coarse)[:, None]
        return field, typed, fine + np.concatenate([gap * light, gap], axis=1)

    def _gradient_error(self) -> float:
        """The largest difference between the derivatives of sum B in float32 and in double.

        It is in parts of the largest derivative or of the largest B: where one Gaussian is alone, its place and shape
        have no effect, and their derivatives are rounding.
        """
        found = []
        for kind, dtype in ((kernels.FieldFloat, np.float32), (kernels.FieldDouble, np.float64)):
            field, level, sums = self._sums(kind, dtype, in_floats=True)
            light, inverse = light_of(sums), inverse_weight(sums)
            ones = np.ones_like(light)
            assert np.isfinite(field.transposed(level, ones, inverse)).all()
            found.append(field.backward(level, light, ones, inverse).astype(float))
        single, double = found
        assert np.isfinite(single).all()
        size = max(np.abs(double).max(initial=0), float(light.max(initial=0)))
        return float(np.abs(single - double).max(initial=0) / (size or 1))

    def by_look_up(self, name: str) -> np.ndarray:
        """As an evaluation on the CPU does, with one instruction set."""
        with instruction_set(name):
            points = (array.astype(np.float32) for array in self.points)
            return look_up(self.fine, self.coarse, self.blend, *points)[0].astype(float)

    def by_c(self) -> np.ndarray:
        """As a host in C does: the library reads what a file keeps."""
        library = c_library_of_tests()
        bake = library.opened(codec.encode(self.bake), sampling=True)
        try:
            return library.sample(bake, *self.points).astype(float)
        finally:
            library.close(bake)

    def by_gl(self, gl: moderngl.Context) -> np.ndarray:
        """As a host gets it, from textures of depth and normal."""
        texels = drawn_by_gl(gl, self.bake, self.pinhole, NEAR * self.seen[0].min() / DISTANCE, *self.seen)
        return texels[..., :3].reshape(-1, 3)


@cache
def c_library_of_tests() -> Library:
    """The C library, built once in a process. Skips where there is no compiler."""
    folder = build(ROOT / "build" / "hard-cases", "-DBUILD_SHARED_LIBS=ON", "-DCMAKE_BUILD_TYPE=Release")
    return Library(folder / "libgsgi.so")


# One line per layer: it answers a Reading with B (S, 3).
LAYERS: dict[str, Callable[[Reading, moderngl.Context | None], np.ndarray]] = {
    "double": lambda reading, _: reading.by_kernel(),
    **{name: lambda reading, _, name=name: reading.by_look_up(name) for name in ALL_SETS},
    "C": lambda reading, _: reading.by_c(),
    "sample": lambda reading, _: sampling.sample(reading.bake, *reading.points),
    "look-up": lambda reading, gl: glsl_lookup.read(gl, reading.bake, *reading.points),
    "llvmpipe": lambda reading, gl: reading.by_gl(gl),
    "softpipe": lambda reading, gl: reading.by_gl(gl),
}


def surface_case(
    group: str, name: str, build, layers: tuple[str, ...] = EVERYWHERE, holds: str = "the oracle's B",
    tolerances: Mapping[str, Tolerance] | None = None, refused: tuple[type[Exception], str] | None = None, **question,
) -> Case:  # fmt: skip
    """A case of the light that the Gaussians of `build()` give: those of the fine level, or those of both levels.

    `question` goes to Reading; a value that is a function is called when the case is built.
    """
    chosen = {layer: _HALF if layer == "softpipe" else TOLERANCES[layer] for layer in layers} | (tolerances or {})

    def reading() -> Reading:
        built = build()
        fine, coarse = built if isinstance(built, tuple) else (built, nobody())
        return replace(Reading(fine, coarse), **{k: v() if callable(v) else v for k, v in question.items()})

    return Case(group, f"surface: {name}", holds, reading, chosen, refused)
