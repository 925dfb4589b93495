"""Files: every attribute at both ends of its range and a step beyond, and what is refused."""

import tracemalloc
from dataclasses import replace

import gsgi_files
import numpy as np

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec as file_codec
from gsgi.runtime.file.header import GAUSSIAN_COUNT_MAX
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend

from .build import NAMES, gaussians, nobody
from .case import Case, Measured, Tolerance
from .stored import TOLERANCE, stored_case, stored_error

ANY = Tolerance(0, "an answer is right or wrong")


def over(given: Gaussians) -> Bake:
    return Bake(given, OverBlend(near=0.01))


def both(given: Gaussians, coarse: Gaussians | None = None) -> Bake:
    return Bake(given, SurfaceBlend(), coarse=nobody() if coarse is None else coarse)


def scaled(*scale) -> Bake:
    """Gaussians at one place of these scales (N, 3)."""
    return over(gaussians(np.zeros((len(scale), 3)), np.array(scale)))


def coloured(*colour) -> Bake:
    """Gaussians at one place of these colours (N, 3)."""
    return over(gaussians(colour=np.array(colour)))


def kept(name: str, build, holds: str = "what is read is within the format's errors, and the same again"):
    return stored_case(name, build, holds)


def not_written(name: str, field: str, value: float) -> Case:
    """A case of a bake whose Gaussian 7 of 20 has a number that the encoder does not take."""

    def build():
        given = replace(gsgi_files.gaussians(20, 1, sloped=True), relief=np.zeros((20, 3, 3), np.float32))
        getattr(given, field)[7] = value
        return both(given)

    refused = AssertionError, rf"Gaussian 7: {field} "
    return stored_case(f"{name} as {field}", build, f"not written, naming {field} and the Gaussian", refused)


def not_read(name: str, field: str, value, holds: str = "refused, naming byte and field") -> Case:
    """A case of a file that is whole but for one field of its header, which no encoder writes."""
    data = gsgi_files.stored("v6_surface" if "." in field or field in ("cutoff", "floor") else "v6_over")
    build = lambda: Measured({"file": lambda _: file_codec.decode(gsgi_files.changed(data, field, value))})  # noqa: E731
    return Case("Codec", name, holds, build, {"file": ANY}, (FormatError, rf"byte \d+ \({field}\): expected"))


def spread(low: float, high: float, count: int = 2000) -> np.ndarray:
    return np.exp(np.random.default_rng(0).uniform(np.log(low), np.log(high), count))


def at_sign_flip() -> np.ndarray:
    """Quaternions whose largest component changes, or changes its sign, from one to the next."""
    angle = np.linspace(0, 2 * np.pi, 721)
    plane = np.stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle], axis=1)
    half = np.full((4, 4), 0.5) * (1 - 2 * np.eye(4))
    return np.concatenate([plane, np.roll(plane, 2, axis=1), half, -half, np.eye(4), -np.eye(4)])


def many(count: int) -> Gaussians:
    """Of every size and place."""
    rng = np.random.default_rng(0)
    return gaussians(
        rng.uniform(-50, 50, (count, 3)), rng.uniform(0.001, 1, (count, 3)), opacity=rng.uniform(0, 1, count)
    )


def five_million() -> float:
    """The largest error in parts of the worst. Encoding and decoding must not take memory many times over."""
    bake = over(many(5_000_000))
    own = sum(getattr(bake.gaussians, name).nbytes for name in NAMES)
    tracemalloc.start()
    file_codec.decode(file_codec.encode(bake))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4 * own, f"{most / own:.1f} times the Gaussians' own {own / 1e9:.2f} GB"
    return stored_error(bake)


CASES = [
    kept("no Gaussians", lambda: over(nobody())),
    kept("no Gaussians in both levels", lambda: both(nobody())),
    kept("a fine level alone", lambda: both(gsgi_files.gaussians(50, 0, sloped=True))),
    kept("one Gaussian", lambda: over(gaussians((3, -4, 5)))),
    replace(kept("300,000 Gaussians", lambda: over(many(300_000))), slow=True),
    Case("Codec", "5,000,000 Gaussians", "the same, in less than four times the memory of the Gaussians, 0.3 GB",
         lambda: Measured({"file": lambda _: five_million()}), {"file": TOLERANCE}, slow=True),
    *[kept(f"SH of degree {k}", lambda k=k: over(gsgi_files.gaussians(200, k))) for k in range(4)],
    kept("slopes", lambda: both(gsgi_files.gaussians(200, 2, sloped=True), gsgi_files.gaussians(30, 2, seed=8))),
    kept("all at one place", lambda: over(gaussians(np.full((9, 3), 1.25)))),
    kept("on one line", lambda: over(gaussians(np.linspace(0, 1, 50)[:, None] * (1, 0, 0)))),
    kept("1e5 m from the origin", lambda: over(gaussians(np.random.default_rng(0).uniform(1e5, 1e5 + 10, (99, 3))))),
    kept("1e-38 m apart", lambda: over(gaussians(np.float32([[0, 0, 0], [0, 0, 1.2e-38]])))),
    kept("1e30 m apart", lambda: over(gaussians(np.float32([[-1e30, 0, 0], [1e30, 1, 0], [0, 0, 0]])))),
    kept("one scale for all", lambda: over(gaussians(np.zeros((9, 3)), 0.37))),
    kept("scales from 1e-12 to 1e6", lambda: scaled(*spread(1e-12, 1e6, 3000).reshape(-1, 3))),
    kept("scales beyond both ends of the range", lambda: scaled([0, 0, 0], [1e-30, 1, 1e30], [3e38, 1, 1]),
         "they are clamped to 2^-57 m to 2^57 m"),
    kept("every opacity of eight bits, and between", lambda: over(gaussians(opacity=np.linspace(0, 1, 1021)))),
    kept("opacities beyond both ends", lambda: over(gaussians(opacity=[-0.1, 0, 1, 1.1])),
         "they are clamped to 0 and 1"),
    kept("light from 1e-4 to 1e4", lambda: coloured(*spread(1e-4, 1e4, 3000).reshape(-1, 3))),
    kept("light at both ends of the range", lambda: coloured([0, 0, 0], [65000, 0, 60000], [2**-32, 0, 0])),
    kept("light beyond them", lambda: coloured([1e10, 1e9, 0], [1e9, 1e30, -1], [-1, -2, -3], [2**-33, 0, 0]),
         "it is clamped to 0 and just less than 2^16"),
    kept("quaternions at the sign flip", lambda: over(gaussians(rotation=at_sign_flip()))),
    kept("zero and non-unit quaternions", lambda: over(gaussians(rotation=[[0.0] * 4, [0, 0, 3, 4], [1e-20, 0, 0, 0]])),
         "they are normalised; zero becomes no turn"),
    kept("slopes at both ends and beyond", lambda: both(gaussians(
        np.zeros((5, 3)), slope=[[0.5, -0.5], [9, -9], [127 / 64, -127 / 64], [0, 1e30], [0.25, -0.25]])),
        "they are clamped to 127 steps of 1/64"),
    *[not_written(name, field, value) for name, value in (("NaN", np.nan), ("infinity", np.inf)) for field in NAMES],
    *[
        not_read(f"{value} as {field}", field, value)
        for field, value in (
            ("near", np.nan), ("near", -1.0), ("dilation", np.inf), ("alpha_min", 0.0), ("tone_scale", 0.0),
            ("cutoff", 0.0), ("cutoff", 1.0), ("floor", 0.0), ("floor", np.inf), ("fine.position_floor", -150),
            ("coarse.position_bits", 17), ("fine.scale_steps", 0), ("coarse.light_steps", 0), ("fine.angle_bits", 99),
            ("fine.basis", 2), ("coarse.sh_degree", 4),
            ("fine.gaussian_count", GAUSSIAN_COUNT_MAX + 1))
    ],
    kept("bounces and fingerprint at their ends", lambda: replace(over(gaussians()), bounces=65535, scene=2**64 - 1)),
]  # fmt: skip
