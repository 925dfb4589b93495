"""Which pixels have a B to fit and to judge: surfaces, however dark, that are neither black metals nor unlit."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation.comparison import compare_indirect
from gsgi.baker.trace import reference
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.baker.trace.visible import Surface
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Environment, Material, Scene, Texture, TextureSlot

SIZE = 56
COLOR = (0.8, 0.6, 0.4, 1.0)
PLAIN, METAL, MIXED, UNLIT, BLACK, NEARLY = range(6)  # the patches by column; beside them there is nothing


def patches() -> Scene:
    """Patches of 1 m under a sky of radiance 1, with metals that are black. MIXED is metal in its right half."""
    ramp = np.full((1, 2, 4), 255, np.uint8)
    ramp[0, 0, 2] = 0
    materials = (
        Material("plain", COLOR),
        Material("metal", COLOR, metallic=1.0),
        Material("mixed", COLOR, metallic=1.0, metallic_texture=TextureSlot(0)),
        Material("unlit", COLOR, unlit=True),
        Material("black", (0.0, 0.0, 0.0, 1.0)),
        Material("nearly", COLOR, metallic=254 / 255),
    )
    meshes = tuple(
        scenes.quad([(k, 0, 0.5), (k + 1, 0, 0.5), (k + 1, 0, -0.5), (k, 0, -0.5)], k) for k in range(len(materials))
    )
    sky = Environment(np.ones((1, 1, 3), np.float32))
    return Scene(meshes, materials, (Texture(ramp, nearest=True),), environment=sky, metals="black")


CAMERA = look_at(np.array([3.0, 6.0, 0.0]), np.array([3.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), 1.1, 0.01)


@pytest.fixture(scope="module")
def tracer() -> Tracer:
    return Tracer(patches())


@pytest.fixture(scope="module")
def surface(tracer) -> Surface:
    return tracer.surface(CAMERA, SIZE, SIZE)


@pytest.fixture(scope="module")
def patch(surface) -> np.ndarray:
    """The patch (H, W) that a pixel sees, -1 where it sees none."""
    return np.where(surface.valid, np.floor(surface.position[..., 0]).astype(int), -1)


@pytest.fixture(scope="module")
def expected(surface, patch) -> np.ndarray:
    left = surface.position[..., 0] % 1 < 0.5
    return np.isin(patch, (PLAIN, BLACK, NEARLY)) | ((patch == MIXED) & left)


def test_b_is_seen_on_diffuse_surfaces_however_dark(surface, patch, expected):
    assert set(np.unique(patch)) == {-1, *range(6)}
    np.testing.assert_array_equal(surface.diffuse, expected)
    # What is left out shows to eight bits no B, except for the black: that is data.
    assert surface.albedo[~surface.diffuse].max() < 0.5 / 255
    assert surface.albedo[patch == BLACK].max() == 0


def test_a_view_holds_b_where_it_is_seen(expected):
    done = []
    traced = CachedTracer(patches(), Cache())
    advance = lambda amount, note="": done.append(amount)  # noqa: E731
    (view,) = traced.views([CAMERA], SIZE, Sampling(32), 0, advance, print)
    np.testing.assert_array_equal(view.valid, expected)
    np.testing.assert_allclose(view.indirect[expected], 1, rtol=1e-5)  # nothing hides the sky
    assert not view.indirect[~expected].any()
    assert sum(done) == SIZE**2


def test_a_reference_judges_b_where_it_is_seen(tracer, patch, expected):
    done = []
    truth = reference.trace(tracer, CAMERA, SIZE, SIZE, 64, seed=0, advance=done.append)
    np.testing.assert_array_equal(truth.valid, expected)
    assert sum(done) == 2 * SIZE**2
    b = np.where(expected[..., None], truth.indirect, np.float32(7))
    assert compare_indirect(b, truth).psnr == 100
    assert compare_indirect(np.where((patch == BLACK)[..., None], 0, b), truth).psnr < 50
    np.testing.assert_allclose(truth.final[patch == UNLIT], np.tile(COLOR[:3], ((patch == UNLIT).sum(), 1)), rtol=1e-5)
    np.testing.assert_allclose(truth.final[patch == PLAIN].mean(axis=0), COLOR[:3], rtol=1e-4)


def test_a_scene_of_black_metal_alone_has_no_b():
    metal = replace(patches(), materials=(Material("metal", COLOR, metallic=1.0),) * 6)
    assert not Tracer(metal).surface(CAMERA, 8, 8).diffuse.any()


def test_a_rough_metal_is_a_surface_like_any_other(patch):
    """Of its base colour, under a sky of radiance 1."""
    truth = reference.trace(Tracer(replace(patches(), metals="rough")), CAMERA, SIZE, SIZE, 64, seed=0)
    seen = np.isin(patch, (PLAIN, METAL, MIXED, NEARLY))
    np.testing.assert_array_equal(truth.valid, seen | (patch == BLACK))
    np.testing.assert_allclose(truth.final[seen], np.tile(COLOR[:3], (seen.sum(), 1)), rtol=1e-4)
