"""Frames in a context of their own, and what they cost."""

import scenes
from frames import full_scene, surface_bake

from gsgi.runtime.gl import headless
from gsgi.runtime.gl.profile import PassCost


def test_costs_are_medians_of_several_frames(monkeypatch, gl, current_again):
    """One slow frame, as the system makes them, does not count."""
    made = []

    class Slow(headless.Profile):
        def __init__(self, ctx):
            super().__init__(ctx)
            made.append(self)

        @property
        def passes(self):
            number = made.index(self)
            return tuple(PassCost(cost.name, number**9, number, 0, cost.fragments) for cost in super().passes)

    monkeypatch.setattr(headless, "Profile", Slow)
    driver, rows = headless.costs(full_scene(), surface_bake(), scenes.inside_camera(), 16, 16, "auto")
    assert driver
    assert len(made) == headless.FRAMES == 9
    assert {(row["gpu_ms"], row["cpu_ms"]) for row in rows} == {(4**9, 4)}
    assert rows[0]["name"] == "frame/gbuffer"
    assert {row["fragments"] for row in rows if row["name"] == "surface/read"} == {16 * 16}


def test_only_the_layers_that_are_asked_for_are_read(gl, current_again):
    layers = headless.draw(full_scene(), None, scenes.inside_camera(), 16, 12, "auto", layers=["depth"])
    assert {name: layer.shape for name, layer in layers.items()} == {"depth": (12, 16)}
