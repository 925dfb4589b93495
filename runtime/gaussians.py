"""The record of a bake: Gaussians and the parameters that turn them into pixels."""

from dataclasses import dataclass, field, replace
from enum import IntFlag

import numpy as np

from . import constants

BASES = "constant", "linear"  # how light varies over one Gaussian; the file's basis is an index into this


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians in world space, with activated parameters (no logarithms, no logits).

    position  (N, 3) float32, m
    rotation  (N, 4) float32, unit quaternion xyzw; the columns of its matrix are the ellipsoid's axes
    scale     (N, 3) float32, standard deviation along each axis, m
    opacity   (N,)   float32, [0, 1]
    sh        (N, K, 3) float32, K = (degree + 1)^2 coefficients of linear Rec.709 demodulated indirect light
    slope     (N, 2) float32: how much brighter the constant band gets per standard deviation along the first and along
              the second axis, relative to the centre; (N, 0), the default, for light that is the same all over a
              Gaussian
    relief    (N, 3, 3) float32: how much the light changes per unit of the mapped normal minus the interpolated one,
              along each axis of world space (first 3) and for each channel (last 3); (N, 0, 3), the default, for light
              of the interpolated normal alone
    """

    position: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray
    opacity: np.ndarray
    sh: np.ndarray
    slope: np.ndarray = None  # (N, 0)
    relief: np.ndarray = None  # (N, 0, 3)

    def __post_init__(self):
        n, k = len(self.position), self.sh.shape[1]
        if self.slope is None:
            object.__setattr__(self, "slope", np.zeros((n, 0), np.float32))
        if self.relief is None:
            object.__setattr__(self, "relief", np.zeros((n, 0, 3), np.float32))
        shapes = {"position": (n, 3), "rotation": (n, 4), "scale": (n, 3), "opacity": (n,), "sh": (n, k, 3)}
        shapes |= {"slope": (n, 2 if self.sloped else 0), "relief": (n, 3 if self.bumpy else 0, 3)}
        for name, shape in shapes.items():
            array = getattr(self, name)
            assert (array.shape, array.dtype) == (shape, np.float32), (name, array.shape, array.dtype, shape)
        assert k in (1, 4, 9, 16), k

    def __len__(self) -> int:
        return len(self.position)

    @property
    def sh_degree(self) -> int:
        """Highest SH degree, 0 to 3."""
        return int(self.sh.shape[1] ** 0.5) - 1

    def clamped(self) -> "Gaussians":
        """The same with scales from SCALE_MIN to SCALE_MAX, which is how the `surface` operator reads them."""
        return replace(
            self, scale=np.clip(self.scale, np.float32(constants.SCALE_MIN), np.float32(constants.SCALE_MAX))
        )

    @property
    def sloped(self) -> bool:
        """Whether the light changes linearly over a Gaussian."""
        return self.slope.shape[1] > 0

    @property
    def bumpy(self) -> bool:
        """Whether the light follows normal maps."""
        return self.relief.shape[1] > 0

    @property
    def basis(self) -> str:
        """How the light varies over a Gaussian, one of BASES."""
        return BASES[int(self.sloped)]


@dataclass(frozen=True)
class OverBlend:
    """Parameters of the `over` operator. The file stores them, so that trainer and shader use the same values."""

    near: float  # m; Gaussians whose centre is closer to the eye plane are not drawn
    dilation: float = constants.DILATION  # px^2
    alpha_min: float = constants.ALPHA_MIN
    alpha_max: float = constants.ALPHA_MAX


@dataclass(frozen=True)
class SurfaceBlend:
    """Parameters of the `surface` operator.

    At a surface point x with normal n, both in world space,

    B(x, n) = (sum w_i c_i(x, n) + gap C(x, n)) / (sum w_i + gap), gap = max(0, floor - sum w_i),
    w_i = opacity_i max(0, G_i(x) - cutoff) max(0, n . n_i)^sharpness

    with G_i(x) = exp(-1/2 (x - position)^T Sigma^-1 (x - position)), n_i the +z axis of the rotation, and c_i(x, n) the
    SH evaluated at n. Where there are slopes, their constant band is multiplied by 1 + slope . (u, v), with u and v the
    coordinates of x - position along the first two axes, in standard deviations. C is the light of the coarse level:
    sum w_i c_i(x, n) / sum w_i over its own Gaussians. They have no `facing` term, so their w_i is
    opacity_i max(0, G_i(x) - cutoff). C contributes only where the weights of the fine level sum to less than `floor`:
    with a lower one, more of the space before a surface, where objects move, has the light of that surface. Where there
    is relief and a normal map bends n to m, relief_i times m - n is added to c_i(x, n), and C is C(x, m).
    """

    cutoff: float = 0.05
    sharpness: int = 2
    floor: float = 0.1

    @property
    def radius(self) -> float:
        """Distance from the centre, in standard deviations, at which a Gaussian ends."""
        return float(np.sqrt(-2 * np.log(self.cutoff)))


class Effects(IntFlag):
    """The effects in the stored light, and how it was made. Only effects that the scene needs are set."""

    PUNCTUAL = 1  # indirect light of point, spot and directional lights
    EMISSIVE = 2  # light of emissive surfaces, including the direct part
    ALPHA_MASK = 4  # some surfaces have cut-outs that let light through
    DENOISED = 8  # the fitted views were denoised
    ENVIRONMENT = 16  # light of the environment (infinitely far away), including the direct part
    DOUBLE_SIDED = 32  # some surfaces are lit from both sides
    NORMAL_MAP = 64  # some surfaces have normal textures; B follows them where there is relief
    UNLIT = 128  # some surfaces are unlit: they show their colour and have no B
    METAL = 256  # some surfaces are metallic, and their albedo is their base colour; without this, metals are black
    CLEAR_PANE = 512  # some surfaces cast no shadow, for they are clear: what lamps send through them is not in B


@dataclass(frozen=True)
class LightGroup:
    """The part of a bake's light that comes from some of the scene's lights: other colours of the same Gaussians.

    `patterns` match the names of its lights (see `runtime.light_groups`); the group "base" has none. sh (N, K, 3) and
    slope (N, 0 or 2) float32 are those of the N Gaussians of the fine level, coarse_sh (M, K, 3) float32 those of the M
    coarse ones.
    """

    name: str
    patterns: tuple[str, ...]
    sh: np.ndarray
    slope: np.ndarray
    coarse_sh: np.ndarray


@dataclass(frozen=True)
class Bake:
    """The content of a .gsgi file.

    `tone_scale` is the k of the loss's tone curve x / (x + k), in units of radiance. `bounces` is the number of
    surfaces that a traced path may visit after the point that it brings light to; it is below 2^16, and 0 means
    unknown. `scene` is the 64-bit `fingerprint` of the scene; 0 means unknown. `coarse` is the coarse level, which
    gives light where none of `gaussians` is near; SurfaceBlend always has it and OverBlend never. Both hold the light
    of all lights together. `groups` hold its parts, if it was baked in groups, without those that have no light.
    """

    gaussians: Gaussians
    blend: OverBlend | SurfaceBlend
    tone_scale: float = 1.0
    effects: Effects = field(default=Effects(0))
    bounces: int = 0
    scene: int = 0
    coarse: Gaussians | None = None
    groups: tuple[LightGroup, ...] = ()


def check_bake(bake) -> None:
    """Raise TypeError, which says how to get one, for what is no Bake, such as the path of a file."""
    if not isinstance(bake, Bake):
        raise TypeError(f"bake: {bake!r:.99} is no Bake: gsgi.read_bake(path) reads one")
