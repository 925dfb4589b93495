"""Path-traced frames show partly transparent surfaces, and what lies behind them, as the renderer does."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.trace.blended import BlendedView
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import BLENDED_MOST, Environment, Filter, Material, Scene

SIZE = 16
AHEAD = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)
SKY = Environment(np.ones((1, 2, 3), np.float32))


def shown(color, opacity: float, tint: float = 0.0) -> Material:
    """A surface that shows its colour as radiance."""
    return Material("film", (*color, opacity), unlit=True, double_sided=True, tint=tint)


def wall(left: float, right: float, material: int):
    """Across the view, so many metres away at its edges."""
    corners = [(-3, -3, -left), (3, -3, -right), (3, 3, -right), (-3, 3, -left)]
    return scenes.quad(corners, material)


def traced(scene: Scene, samples: int = 2) -> np.ndarray:
    advanced = []
    view = BlendedView(Tracer(scene), scene, AHEAD, SIZE, SIZE)
    frame = view.final(samples, 0, False, advanced.append)
    assert sum(advanced) == 2 * (1 + BLENDED_MOST) * SIZE**2
    return frame


MATERIALS = (
    shown((0.2, 0.4, 2.0), 1.0),
    shown((1.0, 0.1, 0.0), 0.25),
    shown((0.5, 1.0, 0.25), 0.0, tint=1.0),
    shown((0.1, 0.8, 0.2), 0.6, tint=0.5),
    shown((1.0, 1.0, 1.0), 0.001),  # too little to be seen: it takes no layer
)


@pytest.mark.parametrize(
    ("solid", "films"),
    [
        ([(8.0, 8.0)], [(2.0, 4.0, 1), (4.0, 2.0, 2), (3.0, 3.0, 3)]),
        ([(2.9, 3.1)], [(2.0, 2.0, 3), (3.0, 3.0, 1), (2.9, 3.1, 3)]),
        ([(-5.0, -5.0)], [(2.0 + 0.1 * k, 3.0 - 0.1 * k, 1 + k % 4) for k in range(9)]),
    ],
    ids=["films that cross", "a solid wall amid films, and a decal on it", "more than can be seen before the sky"],
)
def test_films_are_blended_as_the_renderer_blends_them(gl, solid, films):
    scene = Scene(
        tuple(wall(*depths, 0) for depths in solid),
        MATERIALS,
        blended=tuple(wall(*film) for film in films),
        environment=SKY,
    )
    frame = traced(scene)
    renderer = DeferredRenderer(gl, scene, None, SIZE, SIZE)
    renderer.render(AHEAD)
    np.testing.assert_allclose(frame, renderer.read("final"), rtol=3e-3)
    renderer.release()
    assert np.ptp(frame, axis=(0, 1)).max() > 0.02


def test_films_show_the_light_that_they_reflect():
    """A curtain in the sky has B = 1 on both sides, however much passes its stand-in."""
    cloth = Material("cloth", (0.5, 0.2, 0.1, 0.4), double_sided=True)
    stand_in = replace(cloth, stand_in=True, filter=Filter(blends=True))
    curtain = wall(2.0, 3.0, 0)
    scene = Scene((curtain,), (stand_in, cloth), blended=(replace(curtain, material=1),), environment=SKY)
    frame = traced(scene, 64)
    expected = 0.4 * np.array([0.5, 0.2, 0.1]) + 0.6
    np.testing.assert_allclose(frame[8, 8], expected, rtol=1e-5)
    tinted = replace(cloth, base_color=(0.5, 0.2, 0.1, 0.0), tint=1.0)
    frame = traced(replace(scene, materials=(stand_in, tinted)))
    np.testing.assert_allclose(frame[8, 8], tinted.base_color[:3], rtol=1e-5)


def test_a_view_without_films_is_the_reference():
    from gsgi.baker.trace import reference

    scene = Scene((wall(2.0, 3.0, 0),), (scenes.WHITE,), environment=SKY)
    frame = traced(scene, 8)
    truth = reference.trace(Tracer(scene), AHEAD, SIZE, SIZE, 8, 0)
    np.testing.assert_array_equal(frame, truth.final)
