"""B at single points on the CPU: the oracle's, wherever one asks."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from surface_cases import bent, gaussians, grouped, points, with_relief
from surface_frames import nothing, one, room, surface_gaussians

import gsgi
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import sampling
from gsgi.runtime.constants import SH_C0
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend

TOLERANCE = 1e-3


def assert_equals_oracle(fine, coarse, blend, position, normal):
    light = gsgi.sample(Bake(fine, blend, coarse=coarse), position, normal)
    assert (light.shape, light.dtype) == ((len(position), 3), np.float32)
    with np.errstate(invalid="ignore"):  # nobody is there, and the floor is 0
        sums, expected = oracle.read_surface(fine, coarse, blend, position.astype(float), normal.astype(float))
    # Where the sum of weights is next to nothing, so are its digits: the mean is anything in between.
    weight = sums[..., 3]
    clear = ((weight > 1e-5) | (weight == 0)).all(axis=0)
    assert clear.mean() > 0.8
    expected[(weight[0] == 0) & ((weight[1] == 0) | (blend.floor == 0))] = 0
    np.testing.assert_allclose(light[clear], expected[clear], rtol=TOLERANCE, atol=TOLERANCE)
    return light


@pytest.mark.parametrize(("degree", "sloped"), [(0, True), (1, False), (2, True)])
@pytest.mark.parametrize("floor", [0.0, 0.05, 0.5])
def test_random_gaussians(degree, sloped, floor):
    levels = gaussians(60, (degree + 1) ** 2, sloped=sloped), gaussians(20, 9, seed=7)
    assert_equals_oracle(*levels, SurfaceBlend(cutoff=0.1, sharpness=3, floor=floor), *points(1000))


def test_the_weight_is_that_of_the_fine_level():
    levels, blend, where = (gaussians(60, 1), gaussians(20, 9, seed=7)), SurfaceBlend(cutoff=0.1), points(1000)
    weight = gsgi.Sampler(Bake(levels[0], blend, coarse=levels[1])).weight(*where)
    expected = oracle.read_surface(*levels, blend, *(each.astype(float) for each in where))[0][0, :, 3]
    assert 0.2 < (expected > 0).mean() < 0.9
    np.testing.assert_allclose(weight, expected, rtol=TOLERANCE, atol=1e-5)


def test_free_space_has_the_light_of_the_coarse_level_alone():
    fine, coarse, where = gaussians(60, 1), gaussians(20, 9, seed=7), points(1000)
    bake = with_relief(Bake(fine, SurfaceBlend(cutoff=0.1), coarse=coarse))
    light = gsgi.sample(bake, *where, mapped=bent(where[1]), free=True)
    expected = gsgi.sample(replace(bake, gaussians=nothing()), *where)
    np.testing.assert_allclose(light, expected, rtol=1e-5, atol=1e-6)
    assert np.abs(light - gsgi.sample(bake, *where)).max() > 0.1


@pytest.mark.parametrize("floor", [0.0, 0.5])
@pytest.mark.parametrize(("degree", "sloped"), [(0, True), (2, False)])
def test_light_follows_normal_maps(degree, sloped, floor):
    """As the baker reads it."""
    levels = gaussians(60, (degree + 1) ** 2, sloped=sloped), gaussians(20, 9, seed=7)
    bake = with_relief(Bake(levels[0], SurfaceBlend(cutoff=0.1, sharpness=3, floor=floor), coarse=levels[1]))
    position, normal = points(1000)
    mapped = bent(normal)
    light = gsgi.sample(bake, position, normal, mapped=mapped)
    there = np.linalg.norm(mapped, axis=1, keepdims=True)
    unit = np.where(there > 0, mapped / np.maximum(there, 1e-9), normal).astype(np.float32)
    expected, weight = look_up(bake.gaussians, bake.coarse, bake.blend, position, normal, unit)
    clear = (weight > 1e-3) | (floor > 0)
    assert clear.mean() > 0.4
    np.testing.assert_allclose(light[clear], expected[clear], rtol=TOLERANCE, atol=TOLERANCE)
    flat = gsgi.sample(bake, position, normal)
    assert np.abs(light - flat).mean() > 0.02
    np.testing.assert_array_equal(light[::9], flat[::9])  # where no map bends the normal
    plain = replace(bake, gaussians=replace(bake.gaussians, relief=None))
    for found in (flat, gsgi.sample(plain, position, normal, mapped=mapped)):
        np.testing.assert_array_equal(found, gsgi.sample(plain, position, normal))


def test_relief_turns_no_channel_off():
    """White light, all of it from one side: turned away, a channel that changes more than others ends no sooner."""
    slopes = np.float32([1.0, 1.5, 3.0])
    one = replace(gaussians(1), position=np.zeros((1, 3), np.float32), rotation=np.float32([[0, 0, 0, 1]]))
    white = replace(one, sh=np.full((1, 1, 3), 1 / SH_C0, np.float32), opacity=np.ones(1, np.float32))
    relief = np.zeros((1, 3, 3), np.float32)
    relief[0, 0] = slopes  # along x
    bake = Bake(replace(white, relief=relief), SurfaceBlend(), coarse=gaussians(0, 9))
    angle = np.linspace(-1.5, 1.5, 601)
    mapped = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1).astype(np.float32)
    points = np.zeros((601, 3), np.float32), np.tile(np.float32([0, 0, 1]), (601, 1))
    light = gsgi.sample(bake, *points, mapped=mapped)
    linear = 1 + mapped[:, :1] * slopes
    np.testing.assert_allclose(light[linear >= 0.5], linear[linear >= 0.5], rtol=1e-5)
    assert (light[linear < 0.5] > linear[linear < 0.5]).all()
    assert light.min() > 0.05
    assert (np.diff(light, axis=0) > 0).all()
    assert np.diff(light, axis=0).max() < 0.02  # no step


def test_relief_is_dimmed_with_its_colours():
    bake = with_relief(grouped(Bake(gaussians(30), SurfaceBlend(), coarse=gaussians(20, 9, seed=7))))
    position, normal = points(200)
    mapped = bent(normal)
    half = {"base": 0.5, "lamps": 0.5, "sky": 0.5}
    whole = dict.fromkeys(half, 1.00001)  # not the file's own light, which the groups add up to more than
    both = [gsgi.sample(bake, position, normal, weights, mapped) for weights in (whole, half)]
    np.testing.assert_allclose(both[1], both[0] / 2, rtol=1e-3, atol=1e-4)


def test_on_surfaces():
    fine, coarse = surface_gaussians(room(), 1000), oracle.random_gaussians(30, 2, seed=1)
    where = Triangles(room()).sample(2000, seed=2)
    light = assert_equals_oracle(fine, coarse, SurfaceBlend(), where.position, where.normal)
    assert (light > 0).any(axis=1).all()


def test_many_points_are_read_in_parts(monkeypatch):
    bake = Bake(gaussians(200), SurfaceBlend(), coarse=gaussians(20, 9, seed=7))
    position, normal = points(5000)
    whole = gsgi.sample(bake, position, normal)
    assert len(position) * 200 > sampling.CHUNK
    monkeypatch.setattr(sampling, "POINTS", 777)
    np.testing.assert_allclose(gsgi.sample(bake, position, normal), whole, rtol=1e-5, atol=1e-6)
    some = np.random.default_rng(0).permutation(5000)[:50]
    np.testing.assert_allclose(gsgi.sample(bake, position[some], normal[some]), whole[some], rtol=1e-5, atol=1e-6)


def test_a_thin_wall_keeps_both_sides_apart():
    """Two sheets at one place that face opposite ways: each point reads its own side."""
    front, back = one(rotation=(0, 0, 0, 1), light=1.0), one(rotation=(1, 0, 0, 0), light=5.0)
    both = oracle.Gaussians(*(np.concatenate([getattr(side, name) for side in (front, back)])
                              for name in ("position", "rotation", "scale", "opacity", "sh", "slope")))  # fmt: skip
    bake = Bake(both, SurfaceBlend(), coarse=nothing())
    light = gsgi.sample(bake, np.zeros((2, 3)), np.array([[0, 0, 1], [0, 0, -1]]))
    np.testing.assert_allclose(light, [[1] * 3, [5] * 3], rtol=1e-5)


def test_far_from_the_origin_it_stays_exact():
    far = np.array([1e6, -2e6, 5e5])
    fine, (position, normal) = gaussians(40), points(300)
    near = gsgi.sample(Bake(fine, SurfaceBlend(), coarse=nothing()), position, normal)
    moved = replace(fine, position=(fine.position + far).astype(np.float32))
    # Floats there are an eighth of a metre apart.
    back = replace(fine, position=(moved.position - far).astype(np.float32))
    expected = gsgi.sample(Bake(back, SurfaceBlend(), coarse=nothing()), position, normal)
    light = gsgi.sample(Bake(moved, SurfaceBlend(), coarse=nothing()), position + far, normal)
    np.testing.assert_allclose(light, expected, rtol=1e-3, atol=1e-3)
    assert np.abs(light - near).max() > 0.05  # it did move


def test_normals_are_normalised_and_broken_points_are_dark():
    bake = Bake(one(light=2.0, scale=(1, 1, 1)), SurfaceBlend(), coarse=nothing())
    position = np.array([[0, 0, 0], [0, 0, 0], [np.nan, 0, 0], [0, 0, 0], [1e30, 0, 0]])
    normal = np.array([[0, 7, 0], [0, 0, 0], [0, 1, 0], [np.nan, 1, 0], [0, 1, 0]])
    expected = [[2] * 3, *[[0] * 3] * 4]
    np.testing.assert_allclose(gsgi.sample(bake, position, normal), expected, rtol=1e-5)


def test_the_runtime_names_it_too():
    assert gsgi.runtime.sample is gsgi.sample


def test_no_points():
    bake = Bake(one(), SurfaceBlend(), coarse=nothing())
    assert gsgi.sample(bake, np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 3)


def test_what_cannot_be_read_is_refused():
    with pytest.raises(UnsupportedError, match="`over`"):
        gsgi.sample(Bake(one(), OverBlend(near=0.1)), np.zeros((1, 3)), np.ones((1, 3)))
    bake = Bake(one(), SurfaceBlend(), coarse=nothing())
    for position, normal in ((np.zeros(3), np.zeros(3)), (np.zeros((2, 3)), np.zeros((1, 3))), (np.zeros((2, 2)),) * 2):
        with pytest.raises(ValueError, match=r"both must be \(N, 3\)"):
            gsgi.sample(bake, position, normal)
