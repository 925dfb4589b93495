"""The viewer's picture: its light groups."""

import numpy as np
import scenes
from frames import HEIGHT, WIDTH, full_scene, surface_bake
from surface_cases import grouped

from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.viewer.picture import Picture


def test_groups_are_switched_off_and_on(gl):
    made = grouped(surface_bake())
    picture = Picture(gl, full_scene(), made, (WIDTH, HEIGHT))
    renderer = DeferredRenderer(gl, full_scene(), made, WIDTH, HEIGHT)
    for off in ((), ("lamps",), ("base", "sky"), ()):
        picture.switch_off(off)
        picture.render(scenes.inside_camera(), "final")
        renderer.weights = dict.fromkeys(off, 0)
        renderer.render(scenes.inside_camera())
        np.testing.assert_array_equal(picture.read(), renderer.read("final"))
    picture.release()
    renderer.release()
