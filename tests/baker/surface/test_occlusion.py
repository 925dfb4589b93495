"""Gaussians end at occluders that part bright samples from dark ones, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from scipy.spatial.transform import Rotation
from surface_cases import gaussians, samples_of

from gsgi.baker.fitting.rotations import axes, rotation_to
from gsgi.baker.fitting.schedule import Schedule
from gsgi.baker.surface import occlusion
from gsgi.baker.surface.coarse import coarse_level
from gsgi.baker.surface.fit import fit_surface
from gsgi.baker.surface.lookup import look_up
from gsgi.baker.surface.occlusion import LEAK, VARIES, Occlusion, seen_light
from gsgi.baker.surface.samples import SurfaceSamples, joined
from gsgi.baker.trace.local_light import UNSEEN, local_light
from gsgi.baker.views.directions import random_directions
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend
from gsgi.runtime.scene import Scene

BLEND = SurfaceBlend()
SPACE = replace(BLEND, sharpness=0, floor=0.0)
NOBODY = gaussians(0)
BRIGHT, DARK = 1.0, 2e-4
HALVES = "indirect_a", "indirect_b"
FLOOR = scenes.floor()
TRIANGLES = Triangles(Scene((FLOOR, *scenes.thin_wall()), (scenes.WHITE,)))
OPEN = Triangles(Scene((FLOOR,), (scenes.WHITE,)))


def on_floor(count: int = 8000, dark: float = DARK, noise: float = 0.0) -> SurfaceSamples:
    """Samples of the floor, bright where x < 0."""
    position = np.random.default_rng(0).uniform(-1, 1, (count, 3)) * (1, 0, 1)
    return samples_of(
        step(position, dark), position.astype(np.float32), np.tile(np.float32([0, 1, 0]), (count, 1)), noise
    )


def in_space(count: int = 8000, dark: float = DARK) -> SurfaceSamples:
    rng = np.random.default_rng(0)
    position, normal = rng.uniform((-1, 0, -1), 1, (count, 3)), rng.normal(size=(count, 3))
    unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return samples_of(step(position, dark), position.astype(np.float32), unit.astype(np.float32))


def step(position: np.ndarray, dark: float) -> np.ndarray:
    return np.repeat(np.where(position[:, :1] < 0, BRIGHT, dark), 3, axis=1)


def gaussian(position, scale=(0.2, 0.2, 0.1), normal=(0, 1, 0)) -> Gaussians:
    columns = position, rotation_to(np.array([normal]) / np.linalg.norm(normal))[0], scale, 1.0, np.ones((1, 3))
    return Gaussians(*(np.array([column], np.float32) for column in columns))


def weight(gaussians: Gaussians, x: float, blend: SurfaceBlend = BLEND, z=0.0, normal=(0, 1, 0)) -> float:
    at = np.float32([[x, 0, z]]), np.float32([normal])
    return float(look_up(gaussians, NOBODY, blend, *at)[1][0])


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_a_bright_gaussian_ends_at_the_wall_and_stays_long_beside_it(turn):
    one = gaussian((-0.1, 0, 0), (0.2, 0.12, 0.1))
    spun = np.float32([0, np.sin(turn / 2), 0, np.cos(turn / 2)])  # about the normal, after it is turned upright

    one = replace(
        one, rotation=(Rotation.from_quat(spun) * Rotation.from_quat(one.rotation)).as_quat().astype(np.float32)
    )
    assert weight(one, 0.05) > 0.1
    cut, which = Occlusion(on_floor(), TRIANGLES, BLEND, 50).cut(one)
    assert which.all()
    assert weight(cut, 0.004) == 0
    assert weight(cut, -0.02) > 0.01
    assert weight(cut, -0.1) == pytest.approx(weight(one, -0.1), rel=1e-5)
    beside = max(weight(cut, -0.1, z=z) for z in (-0.2, 0.2))
    assert beside > 0.7 * max(weight(one, -0.1, z=z) for z in (-0.2, 0.2))


@pytest.mark.parametrize("below", [occlusion.NEIGHBOURS, occlusion.FACED])
def test_a_gaussian_on_a_sheet_stays_on_its_side_among_samples_of_the_back(below):
    """Turned round, it would carry the light of a sunlit room into the dark one behind a wall without thickness."""
    back = np.zeros((below, 3), np.float32), np.tile(np.float32([0, -1, 0]), (below, 1))
    samples = joined([on_floor(dark=BRIGHT), samples_of(np.full((below, 3), DARK), *back)])
    one = gaussian((0, 0.001, 0))
    cut, which = Occlusion(samples, OPEN, BLEND, 50).cut(one)
    assert not which.any()
    assert weight(cut, 0) == weight(one, 0) > 0.5
    assert weight(cut, 0, normal=(0, -1, 0)) == 0


def test_red_light_ends_where_a_wall_parts_it_from_a_dimmer_blue():
    """The red one has less than three times the luminance of the blue one."""
    samples, one = on_floor(), gaussian((-0.1, 0, 0))

    def cut(red: float) -> tuple[Gaussians, np.ndarray]:
        colours = np.float32([[red, 0.1, 0.1], [0.1, 1, 1]])
        light = colours[(samples.position[:, 0] >= 0).astype(int)]
        return Occlusion(replace(samples, indirect_a=light, indirect_b=light), TRIANGLES, BLEND, 50).cut(one)

    ended, which = cut(10.0)
    assert which.all()
    assert weight(ended, 0.004) == 0
    assert not cut(3.0)[1].any()


def test_a_cut_keeps_the_gradient_of_the_light_in_metres():
    one = replace(gaussian((-0.1, 0, 0)), slope=np.float32([[0.2, 0.1]]))
    cut, _ = Occlusion(on_floor(), TRIANGLES, BLEND, 50).cut(one)
    assert cut.scale[0].min() < 0.5 * one.scale[0].min()
    gradients = [axes(g.rotation)[0, :, :2] @ (g.slope / g.scale[:, :2])[0] for g in (one, cut)]
    np.testing.assert_allclose(*gradients, atol=1e-5)


def test_a_cut_leaves_no_needle():
    one = gaussian((-0.002, 0, 0))
    cut, which = Occlusion(on_floor(), TRIANGLES, BLEND, 50).cut(one)
    assert which.all()
    assert cut.scale[0].min() < one.scale[0].min() / 50
    assert cut.scale[0, :2].max() <= 1.001 * occlusion.NEEDLE * cut.scale[0, :2].min()


def test_a_cut_lengthens_no_axis_however_thin_the_gaussian():
    rng = np.random.default_rng(0)
    spread = rng.normal(size=(500, 3, 3))
    shape = np.eye(3) + spread @ spread.transpose(0, 2, 1) * rng.uniform(0, 2500, (500, 1, 1))
    scale = np.tile(np.float32([1, 1, 1e-8]), (500, 1))
    _, size = occlusion._principal(shape, scale)
    assert (size > 0).all()
    assert size.max() <= 1


def test_a_dark_gaussian_ends_at_the_wall_too():
    cut, which = Occlusion(on_floor(), TRIANGLES, BLEND, 50).cut(gaussian((0.1, 0, 0)))
    assert which.all()
    assert weight(cut, -0.001) == 0
    assert weight(cut, 0.02) > 0


@pytest.mark.parametrize(
    ("samples", "triangles"), [(on_floor(), OPEN), (on_floor(dark=BRIGHT / 2), TRIANGLES), (on_floor()[:0], TRIANGLES)]
)
def test_without_an_occluder_between_different_light_nothing_is_cut(samples, triangles):
    one = gaussian((-0.1, 0, 0))
    cut, which = Occlusion(samples, triangles, BLEND, 50).cut(one)
    assert not which.any()
    for name, array in vars(one).items():
        np.testing.assert_array_equal(getattr(cut, name), array)


def test_a_gaussian_at_the_foot_of_a_wall_no_longer_faces_the_floor_behind_it():
    wall = np.float32(np.random.default_rng(1).uniform((0, 0, -1), (0, 1, 1), (4000, 3)) - (0.0005, 0, 0))
    lit = samples_of(np.full((4000, 3), BRIGHT), wall, np.tile(np.float32([-1, 0, 0]), (4000, 1)))
    floor = on_floor()
    both = joined([lit, floor])
    one = gaussian((-0.02, 0.1, 0), (0.2, 0.2, 0.15), (-1, 0.8, 0))
    assert weight(one, 0.05) > 0.05
    cut, which = Occlusion(both, TRIANGLES, BLEND, 50).cut(one)
    assert which.all()  # though it does not get smaller
    np.testing.assert_allclose(cut.scale.max(), one.scale.max(), rtol=1e-5)
    assert weight(cut, 0.05) < 1e-3
    at = np.float32([[-0.0005, 0.1, 0]]), np.float32([[-1, 0, 0]])
    assert look_up(cut, cut, BLEND, *at)[1] > 0.5


def test_a_gaussian_in_space_ends_at_the_wall():
    cut, which = Occlusion(in_space(), TRIANGLES, SPACE, 50).cut(gaussian((-0.15, 0.1, 0), (0.2, 0.2, 0.2)))
    assert which.all()
    assert weight(cut, 0.01, SPACE) == 0
    assert weight(cut, -0.1, SPACE) > 0.5


def test_eyes_beside_a_wall_adapt_to_the_light_on_their_side():
    samples = on_floor()
    dark = (samples.position[:, 0] > 0) & (samples.position[:, 0] < 0.02)
    arrays = samples.position, samples.normal, samples.indirect_a, samples.indirect_b
    assert local_light(*arrays).level[dark].max() > 100 * DARK
    around = seen_light(samples, samples[:0], TRIANGLES)
    np.testing.assert_allclose(around.level[samples.position[:, 0] > 0.001], DARK, rtol=0.2)
    # Few dark samples among bright neighbours vary less than VARIES: the level is the mean of them all.
    few = 1 - 1 / (1 + VARIES**2)
    np.testing.assert_allclose(around.level[samples.position[:, 0] < -0.001], BRIGHT, rtol=few)


def test_faint_light_in_a_black_room_is_within_tolerance():
    samples = on_floor(dark=0.0)
    x, level = samples.position[:, 0], seen_light(samples, samples[:0], TRIANGLES).level
    unseen = UNSEEN * BRIGHT / 2
    np.testing.assert_allclose(level[x > 0.5], unseen, rtol=0.05)
    # Next to the wall, so is as little light as leaks through it.
    assert np.median(level[(x > 0) & (x < 0.02)]) == pytest.approx(np.hypot(unseen, LEAK * BRIGHT / 2), rel=0.2)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_room_a_hundred_thousand_times_as_dark_as_another_counts_as_much(noise):
    samples = on_floor(dark=1e-5 * BRIGHT, noise=noise)
    x, level = samples.position[:, 0], seen_light(samples, samples[:0], TRIANGLES).level
    np.testing.assert_allclose(level[x > 0.001], 1e-5 * BRIGHT, rtol=0.2 + 2 * noise)


@pytest.mark.parametrize(("noise", "expected"), [(0.3, 1e-4), (10.0, UNSEEN / 2)])
def test_faint_light_counts_where_it_is_more_than_noise(noise, expected):
    samples = on_floor(dark=1e-4 * BRIGHT, noise=noise)
    level = seen_light(samples, samples[:0], TRIANGLES).level
    assert np.median(level[samples.position[:, 0] > 0.5]) == pytest.approx(expected * BRIGHT, rel=0.2)


def test_eyes_that_see_bright_light_around_adapt_to_that():
    samples = on_floor()
    alone = seen_light(samples, in_space(), TRIANGLES)
    seen = np.where(samples.position[:, 0] > 0.5, 0.3 * BRIGHT, 0).astype(np.float32)
    around = seen_light(replace(samples, seen=seen), in_space(), TRIANGLES)
    np.testing.assert_array_equal(around.level[: len(samples)], np.maximum(alone.level[: len(samples)], seen))
    np.testing.assert_array_equal(around.level[len(samples) :], alone.level[len(samples) :])
    np.testing.assert_array_equal(around.noise, alone.noise)


def test_black_space_behind_a_wall_counts_by_the_light_in_front():
    surface, free = on_floor(), in_space()
    level = seen_light(surface, free, TRIANGLES).level
    alone = seen_light(surface, surface[:0], TRIANGLES).level
    behind, far = ((free.position[:, 0] > a) & (free.position[:, 0] < b) for a, b in ((0.0, 0.02), (0.8, 1.0)))
    assert level[len(surface) :][behind].min() > 0.2 * BRIGHT
    np.testing.assert_allclose(level[len(surface) :][far], DARK, rtol=0.2)
    dark = surface.position[:, 0] > 0.5
    np.testing.assert_allclose(level[: len(surface)][dark], alone[dark], rtol=0.2)


def test_noise_beside_a_wall_is_that_of_the_light_on_its_side():
    dark, noise = 0.05, 0.1
    samples = on_floor(dark=dark, noise=noise)
    around = seen_light(samples, samples[:0], TRIANGLES)
    blocks = samples.blocks.light(samples.indirect_a, samples.indirect_b)
    mixed = (samples.position[:, 0] > 0) & (blocks.level > 4 * dark)
    assert mixed.any()
    assert blocks.noise[mixed].min() > 3 * noise * dark
    relative = (around.noise / around.level)[mixed]  # as that of the mean of two halves, told by few neighbours
    assert np.median(relative) == pytest.approx(noise / np.sqrt(2), rel=0.2)
    assert relative.max() < 2.5 * noise / np.sqrt(2)


def test_dark_samples_at_the_foot_of_a_wall_are_noisy_though_those_behind_it_hardly_are():
    noise, clean = on_floor(noise=0.5), on_floor(noise=0.02)
    dark = clean.position[:, 0] > 0
    halves = {name: np.where(dark[:, None], getattr(noise, name), getattr(clean, name)) for name in HALVES}
    samples = replace(clean, **halves)
    around = seen_light(samples, samples[:0], TRIANGLES)
    relative, foot = around.noise / around.level, np.abs(samples.position[:, 0]) < 0.02
    assert relative[foot & dark].min() > 0.2
    assert relative[foot & ~dark].max() < 0.05


def test_a_fit_that_knows_the_walls_keeps_light_on_its_side():
    samples, space = on_floor(noise=0.1), in_space(4000)

    def light_beside_the_wall(triangles: Triangles | None) -> tuple[float, float, float]:
        """The mean light on the bright side, of a strip next to the wall there, and of one on the dark side."""
        coarse = coarse_level(space, 16, BLEND, 0, triangles)
        fine = fit_surface(samples, samples[:0], coarse, BLEND, Schedule(60, 60, 0), triangles=triangles)
        rng = np.random.default_rng(2)
        strips = [
            rng.uniform((a, 0, -0.9), (b, 0, 0.9), (2000, 3)).astype(np.float32)
            for a, b in ((-0.4, -0.1), (-0.1, 0), (0, 0.05))
        ]
        up = np.tile(np.float32([0, 1, 0]), (2000, 1))
        return tuple(float(look_up(fine, coarse, BLEND, strip, up)[0].mean()) for strip in strips)

    bright, beside, dark = light_beside_the_wall(TRIANGLES)
    assert bright == pytest.approx(BRIGHT, rel=0.05)
    assert beside > 0.3 * BRIGHT
    assert dark < 0.01 * BRIGHT
    # Without them, light ends far before the wall rather than leaks, since errors count relative to the light around.
    assert light_beside_the_wall(None)[1] < 0.3 * beside


def test_cuts_of_the_coarse_level_leave_no_dark_holes_beside_the_wall():
    """Only the Gaussian that lies everywhere would fill them, and it is black where a dark room is near."""
    dark, rng = 0.02, np.random.default_rng(1)
    position = rng.uniform((-1, 0, -1), 1, (20_000, 3)).astype(np.float32)
    normal = random_directions(len(position), rng).astype(np.float32)
    levels = [coarse_level(in_space(dark=dark), 60, BLEND, seed, TRIANGLES) for seed in range(4)]
    light = np.array([look_up(NOBODY, level, BLEND, position, normal)[0].mean(axis=1) for level in levels])
    is_bright = position[:, 0] < 0
    assert (light[:, is_bright] < BRIGHT / 2).mean() < 0.01
    assert (light[:, ~is_bright] > 2 * dark).mean() < 0.01
