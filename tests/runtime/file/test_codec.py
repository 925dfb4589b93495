"""The .gsgi codec: round trip within the quantisation steps, and the stored files."""

from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import ARRAYS, READ, STORED, constant, example, gaussians, reseal, stored, surface_example
from quantisation import errors, in_stored_order

from gsgi.runtime import constants
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import HEADER, VERSION, section
from gsgi.runtime.file.levels import COARSE_STEPS
from gsgi.runtime.gaussians import Bake, Effects, Gaussians, OverBlend, SurfaceBlend
from gsgi.runtime.sampling import sample


def check_round_trip(before: Gaussians, after: Gaussians, level: np.void, facing: bool) -> None:
    """Every attribute is as exact as the format says."""
    assert max(errors(before, after, level, facing).values()) <= 1.001


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_round_trip_stays_within_the_quantisation_steps(degree):
    bake = example(degree=degree)
    data = codec.encode(bake)
    decoded = codec.decode(data)
    check_round_trip(bake.gaussians, decoded.gaussians, np.frombuffer(data, HEADER, 1)[0]["fine"], facing=False)
    assert (decoded.tone_scale, decoded.effects) == (np.float32(0.7), bake.effects)
    assert (decoded.bounces, decoded.scene) == (bake.bounces, bake.scene)
    assert decoded.blend == OverBlend(*map(float, np.float32([0.01, *list(vars(bake.blend).values())[1:]])))
    assert decoded.coarse is None


@pytest.mark.parametrize(("degree", "coarse_degree"), [(0, 2), (2, 0), (1, 1)])
def test_both_levels_stay_within_their_own_quantisation_steps(degree, coarse_degree):
    bake = surface_example(degree=degree, coarse_degree=coarse_degree, sloped=degree < 2)
    bake = replace(bake, coarse=replace(bake.coarse, position=bake.coarse.position * 100, scale=bake.coarse.scale * 9))
    data = codec.encode(bake)
    header, decoded = np.frombuffer(data, HEADER, 1)[0], codec.decode(data)
    check_round_trip(bake.gaussians, decoded.gaussians, header["fine"], facing=True)
    check_round_trip(bake.coarse, decoded.coarse, header["coarse"], facing=False)
    assert (decoded.gaussians.sh_degree, decoded.coarse.sh_degree) == (degree, coarse_degree)
    assert (decoded.blend.cutoff, decoded.blend.floor) == (np.float32(0.04), np.float32(0.002))
    assert (decoded.blend.sharpness, type(decoded.blend.sharpness)) == (4, int)
    assert (decoded.tone_scale, decoded.effects) == (np.float32(0.7), bake.effects)
    assert (decoded.bounces, decoded.scene) == (bake.bounces, bake.scene)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_what_is_read_is_written_as_it_was(degree):
    for bake in (example(degree=degree), surface_example(degree=degree), surface_example(degree=degree, sloped=False)):
        data = codec.encode(bake)
        assert codec.encode(codec.decode(data)) == data


def test_the_order_of_gaussians_does_not_count():
    bake, order = surface_example(), np.random.default_rng(2).permutation(200)
    mixed = Gaussians(*(getattr(bake.gaussians, name)[order] for name in (*ARRAYS, "slope")))
    assert codec.encode(replace(bake, gaussians=mixed)) == codec.encode(bake)


def test_the_encoder_is_deterministic():
    assert codec.encode(example()) == codec.encode(example())
    assert codec.encode(surface_example()) == codec.encode(surface_example())


def test_of_negative_light_only_what_varies_is_kept():
    bake = surface_example(2, 0, 2, 1)
    bake.gaussians.sh[0, 0] = [-1, 0.5, -0.1]
    steps = COARSE_STEPS["sh_steps"]
    bake.coarse.sh[0] = [[1, 0.5, -2], *np.float32([[-16, 5, 14], [4, -18, 2], [0, 0, -18]]) / steps]
    bake.coarse.sh[1] = -1
    data = codec.encode(bake)
    decoded, level = codec.decode(data), np.frombuffer(data, HEADER, 1)[0]["coarse"]
    fine, coarse = in_stored_order(bake.gaussians, level, True), in_stored_order(bake.coarse, level, False)
    for given, read in ((fine, decoded.gaussians), (coarse, decoded.coarse)):
        np.testing.assert_allclose(read.sh[:, 0], np.maximum(given.sh[:, 0], 0), rtol=2 ** (0.5 / 16) - 1)
    lit = coarse.sh[:, 0, 0] == 1
    np.testing.assert_allclose(decoded.coarse.sh[lit, 1:], coarse.sh[lit, 1:], atol=1.03 * 0.5 / steps)
    assert not decoded.coarse.sh[~lit].any()


def test_a_gaussian_that_weighs_little_stays_where_there_is_no_other():
    """The one that covers everything has an opacity of 1/255; light in free space beyond all others depends on it."""
    bake = constant([0.5, 0.25, 0.125])
    faint = replace(bake, coarse=replace(bake.coarse, opacity=np.float32([1 / 255])))
    decoded = codec.decode(codec.encode(faint))
    np.testing.assert_allclose(decoded.coarse.opacity, 1 / 255, rtol=0.01)


def floors(light: dict[float, float]) -> Bake:
    """Rooms of 2 m at these places on the x axis, m, with Gaussians on their floors that vary around this light."""
    x, z = np.meshgrid(np.linspace(0, 2, 15), np.linspace(0, 2, 15))
    rng, place = np.random.default_rng(6), np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    position = np.concatenate([place + rng.normal(size=place.shape) * [0.02, 0.002, 0.02] + [at, 0, 0] for at in light])
    level = np.repeat(list(light.values()), len(place))[:, None]
    up = np.array([-np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # +z becomes +y
    count = len(position)
    fine = Gaussians(
        position=np.float32(position),
        rotation=np.float32(up + 0.02 * rng.normal(size=(count, 4))),
        scale=np.float32(np.exp(0.2 * rng.normal(size=(count, 3))) * [0.17, 0.17, 0.06]),
        opacity=np.float32(rng.uniform(0.3, 0.7, count)),
        sh=np.float32(level * rng.uniform(0.5, 1, (count, 3)) / constants.SH_C0)[:, None],
        slope=np.float32(rng.uniform(-0.2, 0.2, (count, 2))),
    )
    return Bake(fine, SurfaceBlend(), coarse=constant([0.1] * 3).coarse)


def test_errors_are_relative_to_the_light_around():
    """A bright room beside a dim and a black one: in each B is as exact as its own light asks for."""
    rooms = {0.0: 1000.0, 3.0: 1e-4, 6.0: 0.0}
    bake = floors(rooms)
    decoded = codec.decode(codec.encode(bake))
    rng = np.random.default_rng(7)
    for place, light in rooms.items():
        point = np.float32(rng.uniform([place + 0.2, 0, 0.2], [place + 1.8, 0, 1.8], (2000, 3)))
        normal = np.tile(np.float32([0, 1, 0]), (len(point), 1))
        given, read = (sample(each, point, normal) for each in (bake, decoded))
        if not light:
            assert not given.any()
            assert not read.any()
            continue
        error = np.abs(read - given) / given
        assert given.min() > 0.1 * light
        assert np.sqrt((error**2).mean()) < 0.015
        assert error.max() < 0.08


@pytest.mark.parametrize("name", READ)
def test_stored_files_stay_readable(name):
    assert codec.version(stored(name)) == int(name[1]) == VERSION
    bake = codec.decode(stored(name))
    assert (len(bake.gaussians), bake.gaussians.sh_degree) == (3, 1)
    surface = isinstance(bake.blend, SurfaceBlend)
    level = np.frombuffer(stored(name), HEADER, 1)[0]["fine"]
    check_round_trip((surface_example if surface else example)(3, 1).gaussians, bake.gaussians, level, facing=surface)
    assert (bake.bounces, bake.scene) == (300, 0xFEDC_BA98_7654_3210)
    assert bake.effects == Effects.PUNCTUAL | Effects.DENOISED | Effects.UNLIT


def test_the_stored_operators_are_read():
    bake = codec.decode(stored("v6_over"))
    assert bake.blend.dilation == np.float32(constants.DILATION)
    assert bake.coarse is None
    bake = codec.decode(stored("v6_surface"))
    assert np.abs(bake.gaussians.slope).max() == pytest.approx(
        np.abs(surface_example(3, 1).gaussians.slope).max(), abs=0.02
    )
    assert not bake.coarse.sloped
    assert (bake.blend.sharpness, len(bake.coarse), bake.coarse.sh_degree) == (4, 2, 2)
    np.testing.assert_allclose(
        np.sort(bake.coarse.position, axis=0), np.sort(gaussians(2, 2, seed=8).position, axis=0), atol=1e-2
    )


def test_a_gaussian_at_the_origin_leaves_tiny_ones_their_places():
    position, scale = 4e-9 * np.eye(4, 3, -1, np.float32), np.full((4, 3), 1e-9, np.float32)
    tiny = replace(gaussians(4, 0), position=position, scale=scale)
    decoded = codec.decode(codec.encode(Bake(tiny, OverBlend(0.01)))).gaussians
    np.testing.assert_allclose(np.sort(decoded.position, axis=0), np.sort(tiny.position, axis=0), atol=2e-10)


def test_sections_of_other_tags_are_skipped():
    for name in STORED:
        bake = codec.decode(reseal(stored(name) + section(b"LATE", b"later") + section(b"", b"")))
        assert codec.encode(bake) == stored(name)


def test_the_encoder_still_writes_the_stored_bytes():
    assert codec.encode(example(3, 1)) == stored("v6_over")
    assert codec.encode(surface_example(3, 1, 2, 2)) == stored("v6_surface")
