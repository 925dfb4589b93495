"""Relief: the fit follows normal maps, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from bumpy import bumpy_room
from hard_cases.small_bakes import around, small_bake
from surface_cases import gaussians, samples_of

from gsgi.baker.cache.store import Cache
from gsgi.baker.effects import without
from gsgi.baker.native import kernels
from gsgi.baker.surface import relief
from gsgi.baker.surface.lookup import inverse_weight, look_up
from gsgi.baker.surface.optimiser import SurfaceOptimiser
from gsgi.baker.surface.samples import Sampler
from gsgi.baker.surface.seen_surface import SeenSurface
from gsgi.baker.surface.state import PARAMETERS, SurfaceState
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.reference import Reference, trace
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Effects, Gaussians, SurfaceBlend

CAMERAS = around((0, 0, 0))
SETTINGS = {"budget": 300, "samples": 64, "iterations": 40}
SIZE = 64


def flat_room():
    return without(bumpy_room(), ["normal-map"])


@pytest.fixture(scope="module")
def bake() -> Bake:
    return small_bake(bumpy_room(), CAMERAS, **SETTINGS)


@pytest.fixture(scope="module")
def truth() -> Reference:
    scene = bumpy_room()
    return trace(Tracer(scene), scene.cameras["inside"], SIZE, SIZE, 512, 7)


def squared_error(bake: Bake, truth: Reference) -> float:
    """Mean squared error of B, free of the reference's noise."""
    seen, valid = truth.surface, truth.valid
    points = seen.position[valid], seen.normal[valid], seen.shading_normal[valid]
    light, _ = look_up(bake.gaussians, bake.coarse, bake.blend, *points)
    return float(((light - truth.indirect_a[valid]) * (light - truth.indirect_b[valid])).mean())


def test_most_of_the_error_of_ignoring_normal_maps_is_gone(bake, truth):
    flat = small_bake(flat_room(), CAMERAS, **SETTINGS)
    assert Effects.NORMAL_MAP in bake.effects
    assert squared_error(bake, truth) < 0.1 * squared_error(flat, truth)
    assert len(codec.encode(bake)) < 1.4 * len(codec.encode(flat))


def test_without_normal_maps_there_is_no_relief_and_no_byte_of_it(bake):
    flat = small_bake(flat_room(), CAMERAS, **SETTINGS)
    assert not flat.gaussians.bumpy
    assert b"RELF" not in codec.encode(flat)
    assert bake.gaussians.bumpy


def test_hardly_bent_normals_need_no_relief():
    assert not small_bake(bumpy_room(scale=0.01), CAMERAS, budget=64, iterations=4).gaussians.bumpy


def test_samples_are_traced_at_mapped_normals_and_known_light_at_interpolated_ones():
    light = CachedTracer(bumpy_room(), Cache())
    sampler = Sampler.gathering(light, SeenSurface(light, CAMERAS), 3, 0, 0.0, ([1], [1, 1]))
    sampler.prepare(lambda *_: None)
    known, samples = sampler._known_samples, sampler.surface([1], lambda *_: None)[:500]
    assert samples.bumpy
    assert not known.bumpy
    np.testing.assert_allclose(np.linalg.norm(samples.mapped, axis=1), 1, atol=1e-5)
    whole = light.tracer.indirect(samples.position, samples.mapped, samples.normal, Sampling(512, 3), 9).mean
    flat = light.tracer.indirect(samples.position, samples.normal, samples.normal, Sampling(512, 3), 9).mean
    bent = np.square(samples.bend).sum(axis=1) > 0.3**2

    def off(other: np.ndarray) -> float:
        a, b = samples.indirect_a[bent], samples.indirect_b[bent]
        return float(((other[bent] - a) * (other[bent] - b)).mean())

    assert off(whole) < 0.2 * off(flat)


def test_relief_of_one_gaussian_is_read_along_the_bend():
    bumps = np.arange(9, dtype=np.float32).reshape(1, 3, 3) / 20
    one = Gaussians(
        np.zeros((1, 3), np.float32), np.float32([[0, 0, 0, 1]]), np.ones((1, 3), np.float32),
        np.ones(1, np.float32), np.full((1, 1, 3), 2, np.float32), relief=bumps,
    )  # fmt: skip
    nobody = replace(one, relief=None)
    nobody = Gaussians(*(array[:0] for array in vars(nobody).values()))
    blend = SurfaceBlend(floor=1e-6)
    position, normal = np.zeros((1, 3), np.float32), np.float32([[0, 0, 1]])
    mapped = np.float32([[0.6, 0, 0.8]])
    flat, bent = (look_up(one, nobody, blend, position, normal, m)[0] for m in (normal, mapped))
    np.testing.assert_allclose(bent - flat, (mapped - normal) @ bumps[0], atol=1e-6)


def test_black_gaussians_stay_flat():
    """Relief is stored relative to a Gaussian's light, so the light of a file would lack theirs."""
    rng = np.random.default_rng(0)
    position = rng.uniform(-1, 1, (2000, 3)).astype(np.float32) * np.float32([1, 1, 0])
    normal = np.tile(np.float32([0, 0, 1]), (2000, 1))
    bend = rng.uniform(-0.3, 0.3, (2000, 3)).astype(np.float32)
    n, black = 30, np.arange(30) % 3 == 0
    light = np.where(black, 0, 1).astype(np.float32)[:, None, None]
    some = Gaussians(
        position[:n], np.tile(np.float32([0, 0, 0, 1]), (n, 1)), np.full((n, 3), 0.3, np.float32),
        np.full(n, 0.5, np.float32), np.repeat(light, 3, axis=2), relief=np.full((n, 3, 3), 0.1, np.float32),
    )  # fmt: skip
    field, blend = kernels.FieldFloat(position, normal, bend), SurfaceBlend()
    field.list(some, blend.cutoff, blend.sharpness, 1.0)
    inverse = inverse_weight(field.read(some))
    residual = np.repeat(bend[:, :1], 3, axis=1)
    found = relief.solve(field, some, bend, residual, inverse, np.ones(2000, np.float32))
    assert (found[black] == 0).all()
    assert found[~black, 0].mean() > 0.2


def test_samples_that_are_flat_leave_relief_as_it_is():
    """Of bumpy samples, the part that a step looks at may be flat."""
    rng = np.random.default_rng(4)
    position = rng.uniform(0, 1, (500, 3)).astype(np.float32) * np.float32([1, 1, 0])
    flat = samples_of(np.ones((500, 3)), position, np.tile(np.float32([0, 0, 1]), (500, 1)))
    bumps = rng.normal(size=(1, 3, 3)).astype(np.float32)
    one = Gaussians(
        np.float32([[0.5, 0.5, 0]]), np.float32([[0, 0, 0, 1]]), np.full((1, 3), 0.5, np.float32),
        np.full(1, 0.5, np.float32), np.zeros((1, 1, 3), np.float32), np.zeros((1, 2), np.float32), bumps,
    )  # fmt: skip
    optimiser = SurfaceOptimiser(flat, gaussians(0, 9), SurfaceBlend())
    solved = optimiser.solve(one)
    stepped, loss = optimiser.step(SurfaceState.fresh(solved), dict.fromkeys(PARAMETERS, 0.01), 1)
    np.testing.assert_array_equal(solved.relief, bumps)
    np.testing.assert_array_equal(stepped.gaussians.relief, bumps)
    assert 0 <= loss < 1e-3  # the light without it fits
