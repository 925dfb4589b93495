"""Path-traced frames show partly transparent surfaces, and what lies behind them, as the renderer does."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.trace.blended import BlendedView
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import BLENDED_MOST, Environment, Filter, Material, Scene, Texture, TextureSlot

SIZE = 16
AHEAD = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 1.0, 0.01)
SKY = Environment(np.ones((1, 2, 3), np.float32))


def shown(color, opacity: float, tint: float = 0.0) -> Material:
    """A surface that shows its colour as radiance."""
    return Material("film", (*color, opacity), unlit=True, double_sided=True, tint=tint)


def wall(left: float, right: float, material: int, reach: float = 3.0):
    """Across the view, so many metres away at its edges, which are `reach` off its middle."""
    corners = [(-reach, -reach, -left), (reach, -reach, -right), (reach, reach, -right), (-reach, reach, -left)]
    return scenes.quad(corners, material)


def traced(scene: Scene, samples: int = 2) -> np.ndarray:
    advanced = []
    view = BlendedView(Tracer(scene), scene, AHEAD, SIZE, SIZE)
    frame = view.final(samples, 0, lambda truth: truth.indirect, advanced.append)
    assert sum(advanced) == 2 * (1 + BLENDED_MOST * bool(scene.blended)) * SIZE**2
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


@pytest.mark.parametrize("double_sided", [False, True])
def test_decals_lie_on_their_walls(gl, double_sided):
    """Light meets the stand-ins of decals, from which it moves a wall of one side away; frames see neither."""
    paper = replace(shown((0.1, 0.8, 0.2), 0.5), double_sided=double_sided)
    stand_in = replace(paper, stand_in=True, filter=Filter(blends=True))
    solid = replace(shown((0.2, 0.4, 2.0), 1.0), double_sided=False)
    plain, light, seen = (wall(900.0, 1100.0, material, 2000.0) for material in range(3))
    scene = Scene((light, plain), (solid, stand_in, paper), blended=(seen,))
    np.testing.assert_allclose(traced(scene), np.broadcast_to([0.15, 0.6, 1.1], (SIZE, SIZE, 3)), rtol=1e-5)


def test_large_films_that_the_view_grazes_are_blended_once():
    across, along = np.array([0.8, 0.6, 0.0]), np.array([-0.03, 0.04, 0.99875])
    below = -0.01 * np.cross(along, across)
    corners = [4000 * (x * across + y * along) - below for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1))]
    behind, film = wall(9000.0, 9000.0, 0, 30000.0), scenes.quad(corners, 1)
    materials = shown((1.0, 1.0, 1.0), 1.0), shown((0.0, 0.0, 0.0), 0.5)
    frame = traced(Scene((behind,), materials, blended=(film,)))
    assert set(np.unique(frame)) == {0.5, 1.0}
    assert 0.4 < (frame == 0.5).mean() < 0.6


def test_the_noise_of_surfaces_does_not_add_up():
    """Two curtains of opacity 1/2 before a wall under half a sky: as if each was traced alone."""
    from gsgi.baker.trace import reference

    half = Environment(np.concatenate([np.ones((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.float32)]))
    cloth = Material("cloth", (1.0, 1.0, 1.0, 0.5), double_sided=True)
    parts = wall(4.0, 4.0, 0), wall(2.0, 2.0, 1), wall(3.0, 3.0, 1)
    scene = Scene(parts[:1], (scenes.WHITE, cloth), blended=parts[1:], environment=half)
    near = replace(cloth, base_color=(1.0, 1.0, 1.0, 1.0))
    alone = [
        reference.trace(Tracer(Scene((part,), (near, near), environment=half)), AHEAD, SIZE, SIZE, 8, seed).final
        for seed, part in enumerate(parts)
    ]
    variance, *each = (np.var(image[..., 0]) for image in (traced(scene, 8), *alone))
    assert variance == pytest.approx(np.dot(np.square([0.25, 0.5, 0.25]), each), rel=0.4)


def test_black_metals_keep_the_texture_of_their_opacity(gl):
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, 0, 3] = 51
    alpha = TextureSlot(0)
    foil = replace(shown((0.5, 1.0, 0.25), 1.0, tint=0.5), base_color_texture=alpha, metallic=1.0, unlit=False)
    film = replace(wall(2.0, 2.0, 1), uv=np.float32([[[0, 0]], [[1, 0]], [[1, 1]], [[0, 1]]]))
    scene = Scene(
        (wall(4.0, 4.0, 0),),
        (shown((0.2, 0.4, 2.0), 1.0), foil),
        (Texture(pixels, nearest=True),),
        environment=SKY,
        blended=(film,),
        metals="black",
    )
    frame = traced(scene)
    renderer = DeferredRenderer(gl, scene, None, SIZE, SIZE)
    renderer.render(AHEAD)
    np.testing.assert_allclose(frame, renderer.read("final"), atol=3e-3)
    renderer.release()
    assert np.ptp(frame[..., 2]) > 0.5


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
