"""Properties around the cases: Gaussians, cameras and depths that hypothesis makes. What it finds becomes a case."""

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gsgi.runtime.constants import ALPHA_MIN
from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend

from .build import NAMES, PINHOLE, gaussians, joined
from .over import OverImage
from .sort import wrong_places
from .stored import TOLERANCE, stored_error
from .surface import DISTANCE, Reading

# The same examples in each run; the number bounds the seconds.
quick = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


def floats(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, width=32)


def logarithmic(low: float, high: float) -> st.SearchStrategy[float]:
    """Of every magnitude from `low` to `high`."""
    return st.floats(np.log(low), np.log(high)).map(np.exp)


def triples(each: st.SearchStrategy[float]) -> st.SearchStrategy[tuple]:
    return st.tuples(each, each, each)


# Turns about slanted axes.
turns = st.tuples(*[floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(lambda q: q / np.linalg.norm(q))


def one(position, scale) -> st.SearchStrategy:
    """One Gaussian, as opaque as a file can hold."""
    opacity, colour = st.just(0) | floats(2.0**-8, 1), triples(logarithmic(1e-4, 1e4))
    return st.builds(gaussians, triples(position), triples(scale), turns, opacity, colour)


def several(each: st.SearchStrategy, most: int) -> st.SearchStrategy:
    return st.lists(each, min_size=1, max_size=most).map(lambda parts: joined(*parts))


@quick
@given(several(one(floats(-1e6, 1e6), logarithmic(1e-16, 1e16)), 20), st.booleans())
def test_a_file_keeps_every_attribute_to_half_a_step(fine, over):
    bake = Bake(fine, OverBlend(0.01)) if over else Bake(fine, SurfaceBlend(), coarse=fine)
    assert stored_error(bake) <= TOLERANCE.value


@quick
@given(
    several(one(floats(-3, 3), logarithmic(1e-9, 1e5)), 3),
    st.tuples(floats(1, 200), floats(1, 200), floats(-20, 50), floats(-20, 50)),
    st.sampled_from([0.0, 2.0**-7, 1.0]),
)
def test_every_layer_draws_the_oracles_image(gl, scene, lens, near):
    fx, fy, cx, cy = lens
    pinhole = PINHOLE._replace(fx=fx, fy=fy, cx=cx, cy=cy)
    image = OverImage(scene, pinhole, OverBlend(near))
    assert image.error("oracle", None) == 0
    # A contribution of alpha_min on either side of the cut, for each Gaussian and for half of its neighbours' light.
    cut = ALPHA_MIN * len(scene)
    for layer, tolerance in (("torch", 1e-9), ("double", 1e-9), ("scalar", cut), ("llvmpipe", cut)):
        assert image.error(layer, gl) <= tolerance, layer


@quick
@given(
    several(one(floats(-2, 2), logarithmic(1e-3, 1e3)), 3),
    several(one(floats(-2, 2), logarithmic(1e-1, 1e3)), 3),
    turns,
)
def test_every_layer_reads_the_oracles_light(gl, fine, coarse, turn):
    for level in (fine, coarse):
        level.position[:, 2] -= DISTANCE
    x, y, z, w = turn
    normal = (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y))
    reading = Reading(fine, coarse, normal=np.array(normal))
    if reading.expected[1].mean() <= 0.5 or reading.expected_in_floats[1].mean() <= 0.5:
        return  # weights next to nothing, which have no digits
    # float32 knows a weight of 1e-6 of the largest to a few percent, and where a Gaussian is the surface to 1e-7 m.
    # Half floats, in which frames have B, are multiples of 2^-24.
    step = 2.0**-24 / max(float(reading.expected[0].max()), 2.0**-24)
    for layer, tolerance in (
        ("double", 1e-6),
        ("scalar", 1e-3),
        ("sample", 1e-3),
        ("look-up", 1e-3),
        ("llvmpipe", 2e-3 + step / 2),
    ):
        assert reading.error(layer, gl) <= tolerance, layer


@quick
@given(st.lists(st.floats(0, 2.0**127, width=32, exclude_min=True), max_size=200))
def test_any_depths_are_sorted_and_equal_ones_keep_their_order(depth):
    assert wrong_places(np.array(depth)) == 0


def test_the_strategies_reach_what_they_should():
    """Not one narrow kind of Gaussian."""
    found = []

    @quick
    @given(one(floats(-3, 3), logarithmic(1e-9, 1e5)))
    def collect(each):
        found.append(each)

    collect()
    scale = np.concatenate([each.scale for each in found])
    assert scale.min() < 1e-7
    assert scale.max() > 1e3
    assert all(np.isfinite(getattr(each, name)).all() for each in found for name in NAMES)
