"""How often a path asks each punctual light."""

from dataclasses import replace

import numpy as np
import pytest

from gsgi.baker.trace.mitsuba_scene import load_mitsuba
from gsgi.baker.trace.punctual_lights import PunctualLights
from gsgi.runtime.scene import Light

POINT = Light("point", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))
SUN = replace(POINT, kind="directional")
SPOT = replace(POINT, kind="spot", cos_outer=0.5)


def chosen(lights: list[Light], diagonal: float = 10.0) -> np.ndarray:
    """Share of the numbers in [0, 1) at which each light is chosen; checks the probability that comes with it."""
    mi, count = load_mitsuba(), 1 << 16
    choice = PunctualLights(lights, np.zeros(3), np.array([diagonal, 0, 0])).choice
    index, probability = choice.choose(mi.Float((np.arange(count) + 0.5) / count), mi.Float(0), mi.UInt32(0))
    share = np.bincount(np.array(index), minlength=len(lights)) / count
    np.testing.assert_allclose(np.array(probability), share[np.array(index)], atol=2 / count)
    return share


def test_bright_lights_are_asked_more_often_and_weak_ones_not_too_rarely():
    share = chosen([replace(POINT, color=np.full(3, value)) for value in (1.0, 2.0, 5.0, 0.0)])
    np.testing.assert_allclose(share, (np.array([1, 2, 5, 0]) / 8 + 1 / 4) / 2, atol=1e-4)
    np.testing.assert_allclose(chosen([replace(POINT, color=np.zeros(3))] * 2), 0.5, atol=1e-4)


def test_a_spot_light_counts_by_its_cone():
    np.testing.assert_allclose(chosen([POINT, SPOT]), (np.array([4, 1]) / 5 + 1 / 2) / 2, atol=1e-4)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_of_length_does_not_matter(scale):
    scaled = [replace(POINT, color=POINT.color * scale**2), SUN]
    np.testing.assert_allclose(chosen(scaled, 10 * scale), chosen([POINT, SUN], 10), atol=1e-4)
