"""Connections to lit places change the noise of B and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from slit_room import BOUNCES, CLEAR, LAMP, PANE, SPOT, SUN, inside, known, room, traced

from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.trace import known_light as known_lights
from gsgi.baker.trace.irradiance_cache import IrradianceCache, KnownLight
from gsgi.baker.trace.known_light import known_light, known_light_again
from gsgi.baker.trace.lit_places import LIGHTS_MOST, LitPlaces, corners, tree
from gsgi.baker.trace.mitsuba_scene import load_mitsuba
from gsgi.baker.trace.punctual_lights import PunctualLights
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.scene import Environment


def without(cache: IrradianceCache) -> IrradianceCache:
    return replace(cache, lit=LitPlaces())


@pytest.mark.parametrize(
    ("scene", "gain"),
    [
        (room(SUN), 4),
        (room(SPOT), 1.6),
        (room(SUN, SPOT, LAMP), 2),
        (room(SUN, SPOT, across=PANE), 1.6),  # most light is filtered here
        (room(SUN, across=CLEAR), 1.8),
    ],
    ids=["sun", "spot", "three", "pane", "clear pane"],
)
def test_b_is_the_same_with_less_noise(scene, gain, monkeypatch):
    monkeypatch.setattr(known_lights, "PAYS", 0.5)
    tracer = Tracer(scene)
    light = known(tracer)
    assert len(light.a.lit)
    assert len(light.b.lit)
    plain, connected = traced(tracer, without(light.a)), traced(tracer, light.a)
    error = np.sqrt(sum(runs.var(axis=0, ddof=1).sum() / len(runs) for runs in (plain, connected)))
    assert abs((plain - connected).mean(axis=0).sum()) < 4 * error
    assert plain.var(axis=0).mean() > gain * connected.var(axis=0).mean()


def test_where_they_do_not_pay_there_are_none():
    """The sky outweighs the lamp."""
    sky = Environment(np.full((1, 1, 3), 1e3, np.float32))
    assert not len(known(Tracer(replace(room(LAMP, slit=1.0), environment=sky))).a.lit)
    assert not len(known(Tracer(replace(room(slit=1.0), environment=sky))).a.lit)


def test_too_many_lights_have_none():
    assert not len(known(Tracer(room(*[LAMP] * (LIGHTS_MOST + 1))), 2000).a.lit)


def test_after_an_edit_that_no_light_meets_the_places_are_the_same_bits():
    tracer = Tracer(room(SUN, SPOT))
    position, normal = inside(5000)
    halves = [half.mean for half in tracer.halves(position, normal, normal, Sampling(32, BOUNCES - 1), 1)]
    before = known_light(tracer, position, normal, *halves, BOUNCES)
    after = known_light_again(Tracer(room(SUN, SPOT)), position, normal, *halves, BOUNCES, before)
    for a, b in zip(to_arrays(before).values(), to_arrays(after).values(), strict=True):
        np.testing.assert_array_equal(a, b)
    stored = from_arrays(KnownLight, to_arrays(before))
    np.testing.assert_array_equal(stored.b.lit.place, before.b.lit.place)
    dark = known_light_again(Tracer(room(SPOT)), position, normal, *halves, BOUNCES, before)
    assert not len(dark.a.lit)  # another number of lights


def test_leaves_fill_the_square_and_hold_as_many_points_each():
    rng = np.random.default_rng(0)
    points = rng.random((20000, 2)) ** 2
    leaves = corners(*(column[None] for column in tree(points, 6, rng)))[0]
    low, high = leaves.transpose(1, 0, 2)
    assert np.prod(high - low, axis=1).sum() == pytest.approx(1, rel=1e-5)
    held = ((points[:, None] >= low) & (points[:, None] < high)).all(axis=2).sum(axis=0)
    assert held.sum() == len(points)
    assert 0.5 < held.min() / held.mean() < held.max() / held.mean() < 1.5


def test_points_that_coincide_leave_every_leaf_an_area():
    leaves = corners(*(column[None] for column in tree(np.full((5000, 2), 0.25), 8, np.random.default_rng(0))))[0]
    assert (np.prod(leaves[:, 1] - leaves[:, 0], axis=1) > 0).all()


@pytest.mark.parametrize("light", [SUN, SPOT, LAMP], ids=lambda light: light.kind)
def test_directions_are_found_again_where_their_rays_go(light):
    mi = load_mitsuba()
    lights = PunctualLights([light], np.full(3, -1.0), np.full(3, 1.0))
    at = np.random.default_rng(0).uniform(0.01, 0.99, (1000, 2)).astype(np.float32)
    o, d = lights.leave(mi.UInt32(0), mi.Point2f(at.T))
    found, per_area, towards = lights.left(mi.UInt32(0), mi.Point3f(o + 3 * d))
    np.testing.assert_allclose(np.array(found).T, at, atol=2e-4)
    np.testing.assert_allclose(*np.broadcast_arrays(np.array(towards).T, np.array(d).T), atol=1e-5)
    # All of the square lies on 4 R^2 for the sun, and on the sphere's cap of radius 3 m for the others.
    area = {"directional": 12.0, "spot": 2 * np.pi * 0.03 * 9, "point": 4 * np.pi * 9}[light.kind]
    np.testing.assert_allclose(np.array(per_area), 1 / area, rtol=1e-3)
