"""Density control, the mechanism: who is not touched keeps every bit, and what is divided or merged shows the same."""

import numpy as np
import oracle
import pytest
import scenes

from gsgi.baker.over.rasterise import rasterise
from gsgi.baker.over.raw_gaussians import NAMES, RawGaussians
from gsgi.baker.over.reshape import State, divide, extend, keep, merge
from gsgi.baker.over.workspace import AdamState
from gsgi.runtime.constants import ALPHA_MIN, SH_C0
from gsgi.runtime.gaussians import Gaussians, OverBlend

# Lengths and covariances in single precision.
TOLERANCE = 1e-5


def random_raw(count: int, seed: int = 0, degree: int = 1) -> RawGaussians:
    raw = RawGaussians.from_gaussians(oracle.random_gaussians(count, degree, seed))
    raw.rotation[:] *= np.linspace(0.5, 2, count, dtype=np.float32)[:, None]  # any length
    return raw


def trained(count: int = 12) -> State:
    """As after some steps, each Gaussian with its own."""
    return State(
        random_raw(count),
        AdamState(random_raw(count, 1), random_raw(count, 2), np.arange(1, count + 1, dtype=np.int32)),
    )


def rows(state: State) -> list[bytes]:
    """All bits of each Gaussian and of what Adam knows of it."""
    groups = state.raw, state.adam.mean, state.adam.square
    arrays = [getattr(group, name) for group in groups for name in NAMES] + [state.adam.steps]
    return [b"".join(array[i].tobytes() for array in arrays) for i in range(len(state))]


def assert_fit_to_step(state: State):
    """Shapes, dtypes and layout are those that the kernel takes."""
    count = len(state)
    for group in (state.raw, state.adam.mean, state.adam.square):
        for name in NAMES:
            array = getattr(group, name)
            assert (len(array), array.dtype, array.flags.c_contiguous) == (count, np.float32, True), name
    assert (state.adam.steps.shape, state.adam.steps.dtype) == ((count,), np.int32)


def assert_fresh(state: State, first: int):
    """Adam knows nothing of those from `first` on."""
    for group in (state.adam.mean, state.adam.square):
        assert not any(getattr(group, name)[first:].any() for name in NAMES)
    assert not state.adam.steps[first:].any()


def one(scale, rotation=(0, 0, 0, 1), opacity: float = 0.5, position=(0, 0, 0)) -> Gaussians:
    arrays = [position], [rotation], [scale], [opacity], [[[0.8, 0.4, 0.2]]]
    return Gaussians(*(np.array(a, np.float32) for a in arrays))


def state_of(gaussians: Gaussians) -> State:
    return State.fresh(RawGaussians.from_gaussians(gaussians))


def divided(gaussians: Gaussians, clone: bool) -> Gaussians:
    """Both of what one Gaussian is divided into."""
    return divide(state_of(gaussians), np.array([0]), np.array([clone])).raw.to_gaussians()


def covariances(gaussians: Gaussians) -> np.ndarray:
    """(N, 3, 3) float64, m^2."""
    axes = oracle.rotation_matrix(gaussians.rotation.astype(float)) * gaussians.scale.astype(float)[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("which", [[5, 0, 7], [], [*range(12)]])
def test_who_is_kept_keeps_every_bit(which):
    state = trained()
    kept = keep(state, np.array(which, int))
    assert rows(kept) == [rows(state)[i] for i in which]
    mask = np.isin(np.arange(12), which)
    assert rows(keep(state, mask)) == [rows(state)[i] for i in sorted(which)]
    assert_fit_to_step(kept)


def test_what_is_kept_shares_no_memory():
    state = trained()
    before = rows(state)
    kept = keep(state, np.ones(12, bool))
    kept.raw.position[:] = 0
    kept.adam.steps[:] = 0
    assert rows(state) == before


@pytest.mark.parametrize("count", [0, 1, 4])
def test_further_gaussians_come_behind_and_are_fresh(count):
    state, further = trained(), random_raw(count, seed=9)
    extended = extend(state, further)
    assert len(extended) == 12 + count
    assert rows(extended)[:12] == rows(state)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(extended.raw, name)[12:], getattr(further, name))
    assert_fresh(extended, 12)
    assert_fit_to_step(extended)


@pytest.mark.parametrize("which", [[], [3], [0, 4, 11], [*range(12)]])
def test_dividing_leaves_the_others_alone(which):
    state = trained()
    result = divide(state, np.array(which, int), np.arange(len(which)) % 2 == 0)
    others = [i for i in range(12) if i not in which]
    assert len(result) == 12 + len(which)
    assert rows(result)[: len(others)] == [rows(state)[i] for i in others]
    assert_fresh(result, len(others))
    assert_fit_to_step(result)


def test_none_of_none_can_be_divided_or_merged():
    nothing = State.fresh(random_raw(0))
    assert len(divide(nothing, np.empty(0, int), np.empty(0, bool))) == 0
    assert len(merge(nothing, np.empty((0, 2), int))) == 0


def test_a_split_keeps_mean_and_covariance():
    parents = random_raw(40)
    result = divide(State.fresh(parents), np.arange(40), np.zeros(40, bool)).raw.to_gaussians()
    pairs = result.position.astype(float).reshape(2, 40, 3)
    whole = parents.to_gaussians()
    np.testing.assert_allclose(pairs.mean(axis=0), whole.position, atol=TOLERANCE)
    apart = pairs - pairs.mean(axis=0)
    within = covariances(result).reshape(2, 40, 3, 3).mean(axis=0)
    mixture = within + np.einsum("pni,pnj->nij", apart, apart) / 2
    expected = covariances(whole)
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(mixture / size, expected / size, atol=TOLERANCE)
    assert (np.linalg.norm(apart, axis=2) > 0.3 * whole.scale.max(axis=1)).all()  # they do part


@pytest.mark.parametrize("axis", range(3))
def test_a_split_goes_along_the_longest_axis(axis):
    scale = np.full(3, 0.1)
    scale[axis] = 0.2
    halves = divided(one(scale, position=(1, 2, 3)), clone=False)
    apart = halves.position[1] - halves.position[0]
    assert np.flatnonzero(np.abs(apart) > TOLERANCE).tolist() == [axis]
    others = np.arange(3) != axis
    np.testing.assert_allclose(halves.scale[:, others], 0.1, rtol=TOLERANCE)
    assert (halves.scale[:, axis] < 0.2).all()


@pytest.mark.parametrize("length", [0.3, 1.0, 4.0])
def test_the_halves_of_a_turned_needle_lie_on_it(length):
    """A needle along x, turned by 45 degrees about z: it points along x = y. Quaternions may have any length."""
    turn = np.pi / 4
    state = state_of(one((0.2, 0.01, 0.01), (0, 0, np.sin(turn / 2), np.cos(turn / 2)), position=(1, 1, 5)))
    state.raw.rotation[:] *= np.float32(length)
    halves = divide(state, np.array([0]), np.array([False])).raw
    np.testing.assert_allclose(halves.position[:, 0], halves.position[:, 1], atol=TOLERANCE)
    assert np.ptp(halves.position[:, 0]) > 0.1
    np.testing.assert_array_equal(halves.position[:, 2], 5)
    np.testing.assert_array_equal(halves.rotation, np.repeat(state.raw.rotation, 2, axis=0))


def test_the_halves_keep_colour_and_opacity():
    parents = random_raw(6)
    halves = divide(State.fresh(parents), np.arange(6), np.zeros(6, bool)).raw
    for name in ("sh", "logit_opacity", "rotation"):
        np.testing.assert_array_equal(getattr(halves, name), np.concatenate([getattr(parents, name)] * 2))


def test_clones_lie_in_the_place_of_the_parent():
    parents = random_raw(6)
    clones = divide(State.fresh(parents), np.arange(6), np.ones(6, bool)).raw
    for name in ("position", "rotation", "log_scale", "sh"):
        np.testing.assert_array_equal(getattr(clones, name), np.concatenate([getattr(parents, name)] * 2))


@pytest.mark.parametrize("opacity", [0.005, 0.1, 0.5, 0.9, 0.999, 0.9999])
def test_clones_let_through_what_the_parent_does(opacity):
    clones = divided(one((0.1, 0.1, 0.1), opacity=opacity), clone=True).opacity.astype(float)
    # Opacity comes from a logit in single precision, of up to 9: 1e-6 of itself.
    np.testing.assert_allclose((1 - clones).prod(), 1 - opacity, atol=1e-6, rtol=1e-4)
    np.testing.assert_allclose(1 - (1 - clones).prod(), opacity, rtol=1e-4)


@pytest.mark.parametrize("logit", [-20, 20, 60])
def test_clones_are_finite_however_opaque_the_parent_is(logit):
    state = state_of(one((0.1, 0.1, 0.1)))
    state.raw.logit_opacity[:] = logit
    clones = divide(state, np.array([0]), np.array([True])).raw
    assert np.isfinite(clones.logit_opacity).all()


@pytest.mark.parametrize("opacity", [0.1, 0.5, 0.9])
def test_clones_look_like_the_parent(opacity):
    """Two layers of alpha o' g add o'^2 g (1 - g) to one of o g, where g is 1 at the centre and falls to 0."""
    camera, blend = scenes.inside_camera(), OverBlend(near=0.01)
    pinhole = camera.pinhole(41, 41)._replace(cx=20.5, cy=20.5)  # the centre of a pixel
    parent = one((0.1, 0.1, 0.1), opacity=opacity, position=camera.position - 1.5 * camera.world_from_view[:3, 2])
    colour = parent.sh[0, 0] * SH_C0
    alpha, both = (rasterise(g, pinhole, blend) / colour for g in (parent, divided(parent, clone=True)))
    g = alpha / opacity
    expected = alpha + (1 - np.sqrt(1 - opacity)) ** 2 * g * (1 - g)
    assert alpha.max() > 0.999 * opacity
    np.testing.assert_allclose(both[20, 20], alpha[20, 20], rtol=1e-4)
    # Whose alpha is below ALPHA_MIN is not drawn: two clones may lack that much each.
    np.testing.assert_allclose(both, expected, atol=2.01 * ALPHA_MIN)


def test_merging_identical_twins_gives_the_twin_as_opaque_as_both():
    raw = random_raw(5)
    state = extend(State.fresh(raw), raw)
    merged = merge(state, np.stack([np.arange(5), np.arange(5, 10)], axis=1)).raw
    for name in set(NAMES) - {"logit_opacity"}:
        np.testing.assert_array_equal(getattr(merged, name), getattr(raw, name))
    clear = 1 - raw.to_gaussians().opacity
    np.testing.assert_allclose(1 - merged.to_gaussians().opacity, clear**2, rtol=1e-4)


def test_merging_gives_the_middle_and_leaves_the_others_alone():
    state = trained()
    pairs = np.array([[1, 4], [0, 9]])
    merged = merge(state, pairs)
    others = [2, 3, 5, 6, 7, 8, 10, 11]
    assert rows(merged)[:8] == [rows(state)[i] for i in others]
    assert len(merged) == 10
    for name in ("position", "log_scale", "sh"):
        middle = getattr(state.raw, name)[pairs].astype(float).mean(axis=1)
        np.testing.assert_allclose(getattr(merged.raw, name)[8:], middle, rtol=TOLERANCE, atol=TOLERANCE)
    np.testing.assert_array_equal(merged.raw.rotation[8:], state.raw.rotation[pairs[:, 0]])
    assert_fresh(merged, 8)
    assert_fit_to_step(merged)
