"""Reading Gaussians at surface points: equal to the oracle, nobody left out, and the same bits everywhere."""

import numpy as np
import oracle
import pytest
from surface_cases import FIELDS, KINDS, field_of, gaussians, of_type, points

from gsgi.baker.fitting.rotations import axes
from gsgi.baker.native import kernels
from gsgi.baker.surface.lookup import filling, inverse_weight
from gsgi.runtime.constants import SH_C0
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend


def by_oracle(given: Gaussians, position, normal, cutoff: float, sharpness: int) -> np.ndarray:
    """Of sharpness 0 they face every way."""
    return oracle.level_sums(given, cutoff, sharpness or None, position.astype(float), normal)


# Floats: a weight is off by some 1e-6 of the opacity, a colour by as much of its coefficients, of which 100 are summed.
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-12), (np.float32, 2e-5)])
@pytest.mark.parametrize(("coefficients", "sloped"), [(1, False), (4, False), (9, False), (1, True), (9, True)])
@pytest.mark.parametrize(("cutoff", "sharpness"), [(0.05, 0), (0.05, 1), (0.05, 2), (0.2, 5), (1e-4, 2), (0.9, 0)])
def test_reading_equals_the_oracle(dtype, tolerance, coefficients, sloped, cutoff, sharpness):
    position, normal = points(203, dtype)
    given = gaussians(100, coefficients, sloped=sloped)
    expected = by_oracle(given, position, normal, cutoff, sharpness)
    assert expected[:, 3].max() > 0.03
    typed = of_type(given, dtype)
    sums = field_of(typed, position, normal, cutoff, sharpness).read(typed)
    assert sums.dtype == dtype
    np.testing.assert_allclose(sums, expected, atol=tolerance)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 129, 1100])
def test_any_number_of_points(count):
    """One lane, whole blocks, and more than one level of boxes above them."""
    position, normal = points(count)
    given = gaussians(30)
    expected = by_oracle(given, position, normal, 0.05, 2)
    np.testing.assert_allclose(field_of(given, position, normal).read(given), expected, atol=1e-5)


def test_no_points_and_no_gaussians():
    position, normal = points(20)
    nobody = gaussians(0)
    field = kernels.FieldFloat(position, normal)
    np.testing.assert_array_equal(field.read(nobody), np.zeros((20, 4)))  # nobody was listed either
    field.list(nobody, 0.05, 2, 1.0)
    np.testing.assert_array_equal(field.read(nobody), np.zeros((20, 4)))
    ones = np.ones(20, np.float32)
    assert field.backward(nobody, position, normal, ones).shape == (0, 15)
    assert field.transposed(nobody, position, ones).shape == (0, 3)
    assert field.entry_count == 0
    given, empty = gaussians(7, 9, sloped=True), np.empty((0, 3), np.float32)
    field = field_of(given, empty, empty)
    assert field.read(given).shape == (0, 4)
    np.testing.assert_array_equal(field.backward(given, empty, empty, ones[:0]), np.zeros((7, 15)))
    np.testing.assert_array_equal(field.transposed(given, empty, ones[:0]), np.zeros((7, 29)))


@pytest.mark.parametrize("sharpness", [0, 2])
@pytest.mark.parametrize("order", ["coherent", "random"])
def test_the_list_misses_nobody_who_weighs_anything(sharpness, order):
    """What a list with any margin adds weighs nothing: not a bit changes."""
    position, normal = points(5000)
    if order == "coherent":
        position = position[np.lexsort(np.floor(position * 4).T)]
    given = gaussians(500)
    fields = [field_of(given, position, normal, 0.05, sharpness, margin) for margin in (1.0, 1.5, 20.0)]
    assert fields[0].entry_count < fields[1].entry_count < fields[2].entry_count
    first, *others = (field.read(given) for field in fields)
    for other in others:
        np.testing.assert_array_equal(first, other)


def test_gaussians_that_move_within_the_margin_are_still_listed():
    position, normal = points(2000)
    before = gaussians(300)
    after = of_type(before, np.float32, scale=before.scale * np.float32(1.5))
    field = field_of(before, position, normal, margin=1.5 + 1e-5)
    np.testing.assert_array_equal(field.read(after), field_of(after, position, normal).read(after))


@pytest.mark.parametrize(("sharpness", "margin"), [(0, 1.0), (0, 1.3), (2, 1.3)])
def test_the_points_of_other_values_that_gaussians_reach(sharpness, margin):
    position, normal = points(777)
    given = gaussians(150)
    values = np.random.default_rng(5).random((777, 3), np.float32)
    low, high = np.sort(np.random.default_rng(6).random((2, 150, 3), np.float32), axis=0)
    low, high = low - np.float32(0.3), high + np.float32(0.3)
    to = position - given.position[:, None].astype(float)
    offset = np.einsum("nij,npi->npj", axes(given.rotation), to) / given.scale[:, None]
    faced = (axes(given.rotation)[:, None, :, 2] * normal).sum(axis=2) > 0
    there = (np.square(offset).sum(axis=2) < margin**2 * -2 * np.log(0.05)) & (faced | (sharpness == 0))
    differs = ((values < low[:, None]) | (values > high[:, None])).any(axis=2)
    found = kernels.FieldFloat(position, normal).reached(given, 0.05, sharpness, margin, values, low, high)
    assert len(found[0]) > 1000
    assert (there & ~differs).any()
    np.testing.assert_array_equal(found, np.nonzero(there & differs))


def test_a_gaussian_ends_at_its_radius_and_faces_one_way():
    """By hand: one Gaussian of deviations (1, 2, 4), turned by a third about (1, 1, 1), so that +z is the x axis."""
    cutoff = np.exp(-2.0)  # two deviations
    given = of_type(gaussians(1), np.float64, position=np.array([[1.0, 2, 3]]), rotation=np.full((1, 4), 0.5))
    given.scale, given.opacity, given.sh = np.array([[1.0, 2, 4]]), np.array([0.5]), np.ones((1, 1, 3))
    offset = np.array([[0, 0, 0], [4, 0, 0], [7.999, 0, 0], [8.001, 0, 0], [0, 1.999, 0], [0, 2.001, 0], [0, 0, 3.999]])
    straight = np.tile([1.0, 0, 0], (7, 1))
    weights = field_of(given, given.position + offset, straight, cutoff, 2).read(given)[:, 3]
    expected = [0.5 * (1 - cutoff), 0.5 * (np.exp(-0.5) - cutoff)]
    np.testing.assert_allclose(weights[:2], expected, rtol=1e-12)
    np.testing.assert_array_equal(weights > 0, [True, True, True, False, True, False, True])
    sixty = np.array([[0.5, np.sqrt(0.75), 0], [-0.5, np.sqrt(0.75), 0], [0, 0, 1]])
    here = np.repeat(given.position, 3, axis=0)
    for sharpness in (1, 2, 5):
        weights = field_of(given, here, sixty, cutoff, sharpness).read(given)[:, 3]
        np.testing.assert_allclose(weights, [expected[0] * 0.5**sharpness, 0, 0], atol=1e-15)


@pytest.mark.parametrize("sloped", [False, True])
@pytest.mark.parametrize("coefficients", [1, 9])
def test_transposed_is_the_transpose_of_reading(coefficients, sloped):
    """<read(x) / w, v> = <x, transposed(v)>: with the slopes held for all coefficients, with the tint held for both."""
    position, normal = points(333, np.float64)
    given = of_type(gaussians(40, coefficients, sloped=sloped), np.float64)
    field = field_of(given, position, normal)
    values = np.random.default_rng(3).normal(size=position.shape)
    weight = field.read(given)[:, 3]
    inverse = np.divide(1, weight, out=np.zeros(333), where=weight > 0)

    def inner(read) -> float:
        return (read[:, :3] * inverse[:, None] * values).sum()

    size = 3 * coefficients
    flat = of_type(given, np.float64, slope=np.zeros_like(given.slope))
    held, free = (field.transposed(each, values, inverse) for each in (given, flat))
    assert held.shape == (40, size + given.slope.shape[1])
    assert abs(inner(field.read(given))) > 0.1
    sh = given.sh.reshape(40, size)
    assert (sh * held[:, :size]).sum() == pytest.approx(inner(field.read(given)), rel=1e-12)
    tint, other = given.sh[:, 0].copy(), of_type(given, np.float64, sh=given.sh[::-1].copy())
    both = np.concatenate([other.sh.reshape(40, size), given.slope], axis=1)
    assert (both * free).sum() == pytest.approx(inner(field.read(other, tint)), rel=1e-12)


def bumpy(given, dtype=np.float64):
    relief = np.random.default_rng(8).normal(size=(len(given.position), 3, 3))
    return of_type(given, dtype, relief=relief.astype(dtype))


def test_relief_adds_light_along_the_bend():
    position, normal = points(333, np.float64)
    bend = np.random.default_rng(7).normal(size=position.shape)
    given = bumpy(gaussians(40, 9, sloped=True))
    field = kernels.FieldDouble(position, normal, bend)
    field.list(given, 0.05, 2, 1.0)
    sums = field.read(given, relief=True)
    expected = np.zeros((333, 3))
    for axis in range(3):
        flat = of_type(given, np.float64, sh=given.relief[:, axis : axis + 1] / SH_C0, slope=np.zeros((40, 0)))
        expected += bend[:, axis : axis + 1] * field.read(flat)[:, :3]
    np.testing.assert_allclose(sums[:, :3], expected, atol=1e-12)
    np.testing.assert_array_equal(sums[:, 3], field.read(given)[:, 3])
    values, ones = np.random.default_rng(3).normal(size=position.shape), np.ones(333)
    along = field.transposed(given, values, ones, relief=True)
    assert (along * given.relief.reshape(40, 9)).sum() == pytest.approx((expected * values).sum(), rel=1e-12)
    straight = kernels.FieldDouble(position, normal)
    straight.list(given, 0.05, 2, 1.0)
    assert not straight.read(given, relief=True)[:, :3].any()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("coefficients", "sloped"), [(1, False), (1, True), (4, True), (9, True)])
def test_the_normal_product_is_reading_and_its_transpose_to_the_bit(dtype, coefficients, sloped):
    position, normal = points(333, dtype)
    given = bumpy(gaussians(40, coefficients, sloped=sloped), dtype)
    field = KINDS[dtype](position, normal, normal[::-1].copy())
    field.list(given, 0.05, 2, 1.0)
    rng = np.random.default_rng(9)
    weights, inverse = (rng.random(333).astype(dtype) for _ in range(2))
    tint = rng.random((40, 3)).astype(dtype)
    flat = of_type(given, dtype, slope=np.zeros_like(given.slope), sh=given.sh.copy())
    flat.sh[:, 0] = tint

    def twice(at, **how) -> np.ndarray:
        values = weights[:, None] * field.read(given, **how)[:, :3] * inverse[:, None]
        how.pop("tint", None)
        return field.transposed(at, values, inverse, **how)

    np.testing.assert_array_equal(field.normal(given, weights, inverse, tint), twice(flat, tint=tint))
    alone = field.normal(given, weights, inverse)
    np.testing.assert_array_equal(alone, twice(given)[:, : 3 * coefficients])
    assert alone.any()
    np.testing.assert_array_equal(field.normal(given, weights, inverse, relief=True), twice(given, relief=True))


def test_the_coarse_level_fills_the_gap_below_the_floor():
    rng = np.random.default_rng(2)
    sums, coarse = rng.random((5000, 4), np.float32) * 0.1, rng.normal(size=(5000, 3)).astype(np.float32)
    sums[:100] = 0
    for floor in (0.05, 0.0):
        light, inverse, yielding = kernels.fill_gap(sums, coarse, floor)
        filled = sums + filling(sums, coarse, SurfaceBlend(floor=floor))
        np.testing.assert_array_equal(inverse, inverse_weight(filled))
        np.testing.assert_array_equal(light, filled[:, :3] * inverse[:, None])
        np.testing.assert_array_equal(yielding, np.where(sums[:, 3:] < np.float32(floor), coarse, light))
    with pytest.raises(ValueError, match="same length"):
        kernels.fill_gap(sums, coarse[:-1], 0.05)


def test_errors_count_by_the_level_unless_the_light_is_much_brighter():
    rng = np.random.default_rng(3)
    light, residual = (rng.normal(size=(10_000, 3)).astype(np.float32) for _ in range(2))
    level, variance = (rng.random(10_000, np.float32) for _ in range(2))
    importance = kernels.importance(light, level, variance, 3.0)
    bright = np.abs(light.mean(axis=1, dtype=np.float64)) / 3
    assert 0.1 < (bright > level).mean() < 0.9
    np.testing.assert_allclose(importance, 1 / (np.maximum(level, bright) ** 2 + variance), rtol=1e-5)
    by_light, loss = kernels.weigh(importance, residual)
    np.testing.assert_allclose(by_light, 2e-4 * importance[:, None] * residual, rtol=1e-6)
    assert loss == pytest.approx((importance * np.square(residual, dtype=np.float64).sum(axis=1)).mean(), rel=1e-6)
    with pytest.raises(ValueError, match="one value per point"):
        kernels.importance(light, level[:-1], variance, 3.0)
    with pytest.raises(ValueError, match="one value per point"):
        kernels.weigh(importance[:-1], residual)


def all_bits(dtype) -> list[bytes]:
    position, normal = points(3000, dtype)
    given = bumpy(gaussians(400, 4, sloped=True), dtype)
    field = KINDS[dtype](position, normal, normal[::-1].copy())
    field.list(given, 0.05, 2, 1.1)
    sums = field.read(given)
    ones = np.ones(3000, dtype)
    results = sums, field.backward(given, position, normal, ones), field.transposed(given, normal, ones)
    results += tuple(field.normal(given, ones, ones, relief=relief) for relief in (False, True))
    low, high = (np.full((400, 3), limit, dtype) for limit in (-1, 1))
    results += field.reached(given, 0.05, 2, 1.3, sums[:, :3].copy(), low, high)
    return [array.tobytes() for array in results]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_same_bits_for_any_number_of_threads_and_every_instruction_set(dtype):
    expected = all_bits(dtype)
    try:
        for threads in (1, 2, 3):
            kernels.set_thread_count(threads)
            assert all_bits(dtype) == expected
        for name in kernels.instruction_sets():  # the last is the default
            kernels.set_instruction_set(name)
            assert all_bits(dtype) == expected
    finally:
        kernels.set_thread_count(0)
        kernels.set_instruction_set(kernels.instruction_sets()[-1])


@pytest.mark.parametrize("kind", KINDS.values())
def test_wrong_points_are_refused(kind):
    dtype, other = (np.float32, np.float64) if kind is kernels.FieldFloat else (np.float64, np.float32)
    position, normal = points(8, dtype)
    turned = np.asfortranarray(position)
    for wrong in (position.astype(other), position[:, :2].copy(), position[:, 0].copy(), turned, position[::2], None):
        with pytest.raises(TypeError):
            kind(wrong, normal)
        with pytest.raises(TypeError):
            kind(position, wrong)
    with pytest.raises(ValueError, match="same length"):
        kind(position, normal[:-1])


@pytest.mark.parametrize("name", FIELDS)
def test_wrong_gaussians_are_refused(name):
    field = kernels.FieldFloat(*points(8))
    given = gaussians(5, 9, sloped=True)
    array = getattr(given, name)
    wrong = [array.astype(np.float64), array[:-1].copy(), array[..., None], array[::-1]]
    wrong += [np.asfortranarray(array), array[..., :1].copy()] if array.ndim > 1 else []
    for values in wrong:
        with pytest.raises(TypeError):
            field.list(of_type(given, np.float32, **{name: values}), 0.05, 2, 1.0)
    with pytest.raises(TypeError, match="0 or 2"):
        field.list(of_type(given, np.float32, slope=np.zeros((5, 3), np.float32)), 0.05, 2, 1.0)
    with pytest.raises(TypeError, match="1, 4 or 9"):
        field.list(of_type(given, np.float32, sh=given.sh[:, :5].copy()), 0.05, 2, 1.0)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [((0.0, 2, 1.0), "cutoff"), ((1.0, 2, 1.0), "cutoff"), ((0.1, -1, 1.0), "sharp"), ((0.1, 2, 0.9), "margin")],
)
def test_an_impossible_operator_is_refused(arguments, name):
    with pytest.raises(ValueError, match=name):
        kernels.FieldFloat(*points(8)).list(gaussians(5), *arguments)


def test_values_of_another_length_and_other_gaussians_are_refused():
    position, normal = points(20)
    given, ones = gaussians(5), np.ones(20, np.float32)
    field = field_of(given, position, normal)
    right = position, normal, ones
    for i, array in enumerate(right):
        with pytest.raises(ValueError, match="per point"):
            field.backward(given, *right[:i], array[:-1].copy(), *right[i + 1 :])
        with pytest.raises(TypeError):
            field.backward(given, *right[:i], array.astype(np.float64), *right[i + 1 :])
    for lengths in ((19, 5, 5), (20, 4, 5), (20, 5, 4)):
        with pytest.raises(ValueError, match="per"):
            field.reached(given, 0.05, 0, 1.0, *(np.ones((length, 3), np.float32) for length in lengths))
    for wrong in ((ones[:-1], ones), (ones, ones[:-1])):
        with pytest.raises(ValueError, match="per point"):
            field.normal(given, *wrong)
    with pytest.raises(ValueError, match="same length"):
        kernels.FieldFloat(position, normal, normal[:-1])
    for wrong in ((position[:-1], ones), (position, ones[:-1])):
        with pytest.raises(ValueError, match="per point"):
            field.transposed(given, *wrong)
    calls = (field.read,), (field.backward, *right), (field.transposed, position, ones)
    for call, *arguments in calls:
        with pytest.raises(ValueError, match="listed"):
            call(gaussians(6), *arguments)
    with pytest.raises(ValueError, match="one tint"):
        field.read(given, position)
