"""How far what a .gsgi file holds is from what was written, in the worst errors of runtime/file/FORMAT.md."""

import numpy as np

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.file.codes import quantise
from gsgi.runtime.file.levels import LEVEL, STEPS, storage_order
from gsgi.runtime.file.rotations import axes
from gsgi.runtime.gaussians import BASES, Gaussians

FLOAT = 2.0**-23
DARK = 2.0**-10
SCALE_MIN, SCALE_MAX = 2.0**-57, 2.0**57
NORMAL_CELL = (
    2.13  # steps; the angle of half a cell of the octahedron, rad: sqrt(3/2) across a face, sqrt(3) from its middle
)


def in_stored_order(gaussians: Gaussians, level: np.void, facing: bool) -> Gaussians:
    """The Gaussians in the order in which the level of this record holds them."""
    record = np.array(level, LEVEL)
    order = storage_order(quantise(gaussians, record, facing), record)
    return Gaussians(*(getattr(gaussians, name)[order] for name in gaussians.__dataclass_fields__))


def errors(before: Gaussians, after: Gaussians, level: np.void, facing: bool) -> dict[str, float]:
    """The largest error of each attribute in parts of the worst, but for what float32 rounds.

    `before` is in any order; `after` is as read, from a file with this LEVEL record. With `facing` +z must point where
    it did.
    """
    assert (len(before), before.sh_degree, before.basis) == (len(after), after.sh_degree, after.basis)
    assert BASES[level["basis"]] == after.basis
    if not len(before):
        return {}
    before = in_stored_order(before, level, facing)
    steps = {name: float(level[name]) for name in STEPS}
    found = {
        "scale": _scale(before, after) * 2 * steps["scale_steps"],
        "position": _position(before, after, level),
        "rotation": _rotation(before, after, level, facing),
        "opacity": np.abs(np.sqrt(after.opacity) - np.sqrt(np.clip(before.opacity, 0, 1))).max()
        * 2
        * steps["opacity_steps"]
        / (1 + FLOAT),
        "light": _light(before.sh[:, 0], after.sh[:, 0], steps["light_steps"]),
    }
    if after.sh_degree:
        brightest = after.sh[:, :1].max(axis=2, keepdims=True).astype(float)
        error = np.abs(after.sh[:, 1:] - before.sh[:, 1:].astype(float))[brightest[:, 0, 0] > 0]
        share = error / brightest[brightest[:, 0, 0] > 0] * steps["sh_steps"]
        found["sh"] = share.max(initial=0)
        assert not after.sh[brightest[:, 0, 0] == 0].any()
    if after.sloped:
        found["slope"] = _slope(before, after, level)
    return {name: float(value) for name, value in found.items()}


def _scale(before: Gaussians, after: Gaussians) -> float:
    """The largest error of a standard deviation in octaves; axes are compared by length, since they may be renamed."""
    given, read = (np.log2(np.clip(g.scale.astype(float), SCALE_MIN, SCALE_MAX)) for g in (before, after))
    return max(np.abs(np.sort(read, axis=1) - np.sort(given, axis=1)).max() - 4 * FLOAT, 0)


def _position(before: Gaussians, after: Gaussians, level: np.void) -> float:
    long, middle, normal = after.scale.astype(float).T
    shortest = np.maximum(np.minimum(middle, normal), long / 16) * (1 + 4 * FLOAT)
    exponent = np.maximum(np.floor(np.log2(shortest)) - level["position_bits"], float(level["position_floor"]))
    return (np.abs(after.position - before.position.astype(float)).max(axis=1) / 2.0 ** (exponent - 1)).max()


def _rotation(before: Gaussians, after: Gaussians, level: np.void, facing: bool) -> float:
    """The largest angle between two axes that must be the same, as a share of what may be."""
    given, read = axes(before.rotation), axes(after.rotation)
    scale_steps, normal = float(level["scale_steps"]), NORMAL_CELL / float(level["normal_steps"])
    length = after.scale.astype(float)
    # Pair axes by length; those of nearly one length in a plane may stand at any angle in it.
    own, order = np.argsort(-before.scale, axis=1, kind="stable"), np.argsort(-length, axis=1, kind="stable")
    shares = [0.0]
    if facing:
        across = np.linalg.norm(np.cross(given[:, :, 2], read[:, :, 2]), axis=1)
        assert ((given[:, :, 2] * read[:, :, 2]).sum(axis=1) > 0).all()
        shares.append((np.arcsin(np.minimum(across, 1)) / normal).max())
        own, order = np.argsort(-before.scale[:, :2], axis=1), np.argsort(-length[:, :2], axis=1)
    rows = np.arange(len(length))
    lengths = np.take_along_axis(np.log2(length), order, axis=1)
    for axis in range(lengths.shape[1]):
        apart = np.abs(lengths - lengths[:, axis : axis + 1]) + 1e9 * (np.arange(lengths.shape[1]) == axis)
        clear = apart.min(axis=1) > 2.5 / scale_steps
        difference = np.rint(apart.min(axis=1) * scale_steps)
        turn = np.pi / 2.0 ** (np.floor(np.log2(np.maximum(difference, 1))) + 2 + float(level["angle_bits"]))
        a, b = given[rows, :, own[:, axis]], read[rows, :, order[:, axis]]
        angle = np.arcsin(np.minimum(np.linalg.norm(np.cross(a, b), axis=1), 1))
        shares.append((angle / (turn + 2 * normal))[clear].max(initial=0))
    return max(shares)


def _light(given: np.ndarray, read: np.ndarray, steps: float) -> float:
    given, read = np.clip(given.astype(float) * SH_C0, 0, 2 ** (16 - 1 / steps)), read.astype(float) * SH_C0
    brightest = given.max(axis=1, keepdims=True)
    black = read == 0
    # Black: what is darker than the code of the faintest light, or than DARK times the brightest channel.
    half = 2 ** (0.5 / steps)
    assert (given[black] <= np.maximum(2.0**-32, brightest * DARK)[np.nonzero(black)[0], 0] * half * half).all()
    ratio = np.log2(np.where(black, 1, read) / np.where(black, 1, np.maximum(given, 1e-300)))
    return max(np.abs(ratio).max() - 4 * FLOAT, 0) * 2 * steps


def _slope(before: Gaussians, after: Gaussians, level: np.void) -> float:
    """The largest error of the gradient along an axis, in halves of its step, but for what the axes are off by."""
    most, step = 127 / float(level["slope_steps"]), 1 / float(level["slope_steps"])
    given = np.clip(before.slope.astype(float), -most, most)
    a, b = axes(before.rotation)[:, :, :2], axes(after.rotation)[:, :, :2]
    same = np.einsum("nik,nil->nkl", a, b)  # of axis k before and axis l after
    octave = np.abs(np.log2(after.scale[:, 0] / after.scale[:, 1].astype(float))) >= 1
    matched = np.where(np.abs(same) == np.abs(same).max(axis=1, keepdims=True), np.sign(same), 0)
    along = np.einsum("nk,nkl->nl", given, np.where(octave[:, None, None], matched, same))
    tilt = np.abs(given).max(axis=1, keepdims=True) * 3 * NORMAL_CELL / float(level["normal_steps"])
    off = np.where(octave[:, None], 0, 0.05 * np.abs(given).max(axis=1, keepdims=True)) + tilt
    return (np.maximum(np.abs(after.slope - along) - off, 0) / (step / 2)).max()
