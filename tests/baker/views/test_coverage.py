"""Shares of the surface that are seen, and hidden surface."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.baker.views import coverage
from gsgi.baker.views.surface_points import Triangles
from gsgi.baker.views.visibility import VIEWS, sides, sight_lines
from gsgi.runtime.scene import Material, Scene


def test_shares_and_hidden_area_are_what_geometry_says():
    # Two floors of 4 m^2, one of them seen from three places, the other from none.
    floors = scenes.floor(), replace(scenes.floor(material=1), position=scenes.floor(height=-1.0).position)
    triangles = Triangles(Scene(floors, (Material("top"), Material(""))))
    sampled = sides(triangles.draw(500, np.random.default_rng(0)))
    cameras = [scenes.above_camera(height) for height in (3.0, 4.0, 12.0)]
    meter = coverage.CoverageMeter(triangles, sampled, sampled, [], 100)
    meter.look_from(np.array([camera.position for camera in cameras]))
    meter.add(cameras)
    result = meter.coverage(limit=0.05)
    assert result.seen == (1, 1, 0)  # the third camera is too far for 5 cm
    assert not result.reached
    assert meter.coverage(limit=0.2).reached
    assert result.visible_area == pytest.approx(4, abs=0.02)
    (hidden,) = result.hidden
    assert hidden.material == "material 1"
    assert hidden.area == pytest.approx(4, abs=0.02)
    assert hidden.share == pytest.approx(0.5, abs=0.003)
    assert 0.1 < result.texel_median < result.texel_p95 < 0.13


def test_summary_names_what_matters():
    hidden = tuple(coverage.Hidden(name, 2.0, 0.1) for name in "abcdef")
    result = coverage.Coverage((1.0, 1.0, 0.9934), 0.041, 0.012, np.inf, 61.0, hidden, 10)
    lines = coverage.coverage_summary(result)
    assert lines[0] == (
        "99.3 % of what people see (61 m^2) is seen by 3 views at 41 mm per texel or finer "
        "(half at 12 mm, 95 % not at all)"
    )
    assert lines[1] == "hidden: a: 2 m^2 (10.0 % of all surface)"
    assert lines[-1] == "hidden: 2 further materials: 4 m^2 (20.0 %)"
    assert len(lines) == 6


def test_sides_of_a_double_sided_sheet_are_seen_apart():
    triangles = Triangles(Scene((scenes.floor(),), (Material(double_sided=True),)))
    both = sides(triangles.draw(100, np.random.default_rng(0)))
    assert len(both) == 200
    times = coverage.seen_by(triangles, [scenes.above_camera(3.0)], both.points)
    np.testing.assert_array_equal(times, np.repeat([1, 0], 100))


def test_what_is_seen_does_not_depend_on_how_many_viewpoints_look_together(monkeypatch):
    """Sides that enough viewpoints see are looked at no more, and viewpoints may come in any portions."""
    lower = replace(scenes.floor(), position=scenes.floor(height=-1.0).position)
    triangles = Triangles(Scene((scenes.floor(), lower), (scenes.WHITE,)))
    sampled = sides(triangles.draw(300, np.random.default_rng(0)))
    viewpoints = np.random.default_rng(1).uniform((-4, -0.9, -4), (4, 1, 4), (9, 3))
    lines = sight_lines(triangles, viewpoints, sampled.points)
    expected = np.bincount(lines.side, minlength=len(sampled)) >= VIEWS
    assert 0 < expected.sum() < len(sampled)
    for portion in (1, 4, 9):
        monkeypatch.setattr(coverage, "VIEWPOINTS_AT_ONCE", portion)
        meter = coverage.CoverageMeter(triangles, sampled, sampled, [], 100)
        meter.look_from(viewpoints[:2])
        meter.look_from(viewpoints[2:])
        assert (meter.free == expected).all()
