"""Views into spaces that no light reaches are known, sampled less, and no test of a picture."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.store import Cache
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.local_light import FAINT
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling
from gsgi.baker.views.dark_views import LOOKS, dark_views
from gsgi.baker.views.placement import HELD_OUT, Placement
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Scene

APART = 10.0  # m, between two closed boxes


def two_boxes() -> Scene:
    """One with walls that shine, and one without light, beside it."""
    shining = scenes.furnace()
    dark = [replace(mesh, position=mesh.position + np.float32([APART, 0, 0]), material=1) for mesh in scenes.box()]
    return replace(shining, meshes=(*shining.meshes, *dark), materials=(*shining.materials[:1], scenes.WHITE))


def camera_at(x: float):
    camera = scenes.inside_camera()
    pose = camera.world_from_view.copy()
    pose[0, 3] += x
    return replace(camera, world_from_view=pose)


CAMERAS = {"lit": scenes.inside_camera(), "dark": camera_at(APART)}


@pytest.fixture(scope="module")
def light():
    return CachedTracer(two_boxes(), Cache())


def test_the_camera_in_the_box_without_light_is_dark(light):
    triangles = Triangles(light.scene)
    assert dark_views(triangles, CAMERAS, light.at_points, 4, seed=0) == {"dark"}
    away = look_at(np.array([0.0, 50, 0]), np.array([0.0, 60, 0]), np.array([0.0, 0, 1]), 1.0, 0.01)
    for cameras, dark in (({"away": away}, set()), (CAMERAS | {"away": away}, {"dark"})):
        assert dark_views(triangles, cameras, light.at_points, 4, seed=0) == dark


@pytest.mark.parametrize(("light_there", "dark"), [(0.0, True), (0.5 * FAINT, True), (2 * FAINT, False), (1.0, False)])
def test_dark_is_what_has_a_millionth_of_the_light_of_all_views(light_there, dark):
    def at_points(position, normal, sampling, _seed):
        assert sampling in [Sampling(passes * PASS_SAMPLES, 3) for passes in LOOKS]
        assert np.allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-5)
        other = position[:, 0] > APART / 2
        # Towards the viewpoint, inwards.
        middle = np.where(other[:, None], [APART, 0, 0], [0, 0, 0])
        assert ((position - middle) * normal < 1e-4).all()
        return SimpleNamespace(mean=np.where(other, light_there * (2 - light_there), 2.0)[:, None].repeat(3, 1))

    # The mean of both is 1 where the other box is black.
    found = dark_views(Triangles(two_boxes()), CAMERAS, at_points, 3, seed=0)
    assert found == ({"dark"} if dark else set())


def test_what_seems_dark_is_looked_at_longer():
    looks = []

    def rarely(position, _normal, sampling, _seed):
        looks.append((len(position), sampling.samples))
        found = 2 * FAINT if sampling.samples > PASS_SAMPLES else 0.0
        return SimpleNamespace(mean=np.where(position[:, :1] > APART / 2, found, 1.0).repeat(3, 1))

    assert dark_views(Triangles(two_boxes()), CAMERAS, rarely, 3, seed=0) == frozenset()
    (both, few), (one, many) = looks
    assert one == both / 2
    assert (few, many) == (PASS_SAMPLES, LOOKS[1] * PASS_SAMPLES)


def test_without_any_light_no_view_is_darker_than_the_others():
    def black(position, *_):
        return SimpleNamespace(mean=np.zeros_like(position))

    assert dark_views(Triangles(two_boxes()), CAMERAS, black, 3, seed=0) == frozenset()


def test_the_first_views_with_light_are_held_out():
    held_out = {str(i): scenes.inside_camera() for i in range(2 * HELD_OUT)}
    placement = Placement({}, held_out, None, None)
    assert list(placement.without_dark(set()).held_out) == [str(i) for i in range(HELD_OUT)]
    without = placement.without_dark({"1", "3"}).held_out
    assert list(without) == ["0", "2", *(str(i) for i in range(4, HELD_OUT + 2))]
    assert not placement.without_dark(held_out.keys()).held_out
