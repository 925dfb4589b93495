"""The .gsgi codec: round trip within the quantisation steps, and the stored files."""

from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import ARRAYS, STORED, example, gaussians, stored, surface_example

from gsgi.runtime import constants
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import HEADER, VERSION
from gsgi.runtime.gaussians import Effects, Gaussians, OverBlend


def check_round_trip(before: Gaussians, after: Gaussians, level: np.void) -> None:
    slack = 1.001  # float32 rounding of the decoded value itself
    assert (np.abs(after.position - before.position) <= level["position_step"] / 2 * slack + 1e-6).all()
    log_error = np.abs(np.log(after.scale) - np.log(before.scale))
    assert log_error.max() <= level["log_scale_step"] / 2 * slack + 1e-6
    assert np.abs(after.opacity - before.opacity).max() <= 1 / 510 * slack
    dc_step = before.sh[:, 0].max(axis=1, keepdims=True) / 512
    assert (np.abs(after.sh[:, 0] - before.sh[:, 0]) <= dc_step * slack).all()
    rest_step = level["sh_rest_step"] / 2 * after.sh[:, :1].max(axis=2, keepdims=True)
    assert (np.abs(after.sh[:, 1:] - before.sh[:, 1:]) <= rest_step * slack + 1e-6).all()
    assert after.sloped == before.sloped
    if before.sloped:
        assert np.abs(after.slope - before.slope).max() <= 1 / 512
    # q and -q are one rotation; four components of error 0.0007 each turn it by less than 0.004 rad.
    alignment = np.abs((after.rotation * before.rotation).sum(axis=1))
    assert (2 * np.arccos(np.clip(alignment, 0, 1)) < 0.004).all()


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_round_trip_stays_within_the_quantisation_steps(degree):
    bake = example(degree=degree)
    data = codec.encode(bake)
    decoded = codec.decode(data)
    check_round_trip(bake.gaussians, decoded.gaussians, np.frombuffer(data, HEADER, 1)[0]["fine"])
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
    check_round_trip(bake.gaussians, decoded.gaussians, header["fine"])
    check_round_trip(bake.coarse, decoded.coarse, header["coarse"])
    assert (decoded.gaussians.sh_degree, decoded.coarse.sh_degree) == (degree, coarse_degree)
    assert (decoded.blend.cutoff, decoded.blend.floor) == (np.float32(0.04), np.float32(0.002))
    assert (decoded.blend.sharpness, type(decoded.blend.sharpness)) == (4, int)
    assert (decoded.tone_scale, decoded.effects) == (np.float32(0.7), bake.effects)
    assert (decoded.bounces, decoded.scene) == (bake.bounces, bake.scene)


def test_a_level_is_stored_the_same_alone_and_beside_another():
    over, both = example(41, 1), surface_example(41, 1)
    decoded = codec.decode(codec.encode(both)).gaussians
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(decoded, name), getattr(codec.decode(codec.encode(over)).gaussians, name))


def test_the_encoder_is_deterministic():
    assert codec.encode(example()) == codec.encode(example())
    assert codec.encode(surface_example()) == codec.encode(surface_example())


@pytest.mark.parametrize(("degree", "coarse_degree"), [(0, 2), (2, 1)])
def test_the_size_of_a_file_is_known_before(degree, coarse_degree):
    assert len(codec.encode(example(5, degree))) == codec.file_bytes(5, degree)
    bake = surface_example(5, degree, 3, coarse_degree)
    assert len(codec.encode(bake)) == codec.file_bytes(5, degree, 3, coarse_degree, "linear")
    bake = surface_example(5, degree, 3, coarse_degree, sloped=False)
    assert len(codec.encode(bake)) == codec.file_bytes(5, degree, 3, coarse_degree)


def test_of_negative_light_only_what_varies_is_kept():
    bake = surface_example(2, 0, 2, 1)
    bake.gaussians.sh[0, 0] = [-1, 0.5, -0.1]
    bake.coarse.sh[0] = [[1, 0.5, -2], [-0.9, 0.3, 0.8], [0.2, -1, 0.1], [0, 0, -1]]
    bake.coarse.sh[1] = -1
    decoded = codec.decode(codec.encode(bake))
    # Steps: 1/512 of the brightest channel for degree 0, 1/127 of the greatest ratio to it for the others.
    np.testing.assert_allclose(decoded.gaussians.sh[0, 0], [0, 0.5, 0], atol=0.5 / 512)
    np.testing.assert_allclose(decoded.coarse.sh[0, 0], [1, 0.5, 0], atol=1 / 512)
    np.testing.assert_allclose(decoded.coarse.sh[0, 1:], bake.coarse.sh[0, 1:], atol=1.01 / 254)
    assert not decoded.coarse.sh[1].any()


@pytest.mark.parametrize("name", STORED)
def test_stored_files_stay_readable(name):
    assert codec.version(stored(name)) == int(name[1]) == VERSION
    bake = codec.decode(stored(name))
    assert (len(bake.gaussians), bake.gaussians.sh_degree) == (3, 1)
    np.testing.assert_allclose(bake.gaussians.position, example(3, 1).gaussians.position, atol=1e-3)
    expected = example(3, 1).gaussians.sh[:, 0]
    assert (np.abs(bake.gaussians.sh[:, 0] - expected) <= expected.max(axis=1, keepdims=True) / 511).all()
    assert (bake.bounces, bake.scene) == (300, 0xFEDC_BA98_7654_3210)
    assert bake.effects == Effects.PUNCTUAL | Effects.DENOISED | Effects.UNLIT


def test_the_stored_operators_are_read():
    bake = codec.decode(stored("v4_over"))
    assert bake.blend.dilation == np.float32(constants.DILATION)
    assert bake.coarse is None
    bake = codec.decode(stored("v4_surface"))
    np.testing.assert_allclose(bake.gaussians.slope, surface_example(3, 1).gaussians.slope, atol=1 / 512)
    assert not bake.coarse.sloped
    assert (bake.blend.sharpness, len(bake.coarse), bake.coarse.sh_degree) == (4, 2, 2)
    np.testing.assert_allclose(bake.coarse.position, gaussians(2, 2, seed=8).position, atol=1e-3)


def test_the_encoder_still_writes_the_stored_bytes():
    assert codec.encode(example(3, 1)) == stored("v4_over")
    assert codec.encode(surface_example(3, 1, 2, 2)) == stored("v4_surface")
