"""Triangles that are cut at a box."""

import numpy as np

from gsgi.baker.views.boxes import in_box
from gsgi.baker.views.clipping import clipped


def area_normals(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2


def test_parts_cover_what_lies_inside_and_keep_their_side():
    rng = np.random.default_rng(2)
    corners = rng.uniform(-2, 2, (60, 3, 3)).astype(np.float32)
    box = np.array([[-1.0, -0.5, -1], [0.7, 1, 0.9]])
    parts, of = clipped(corners, box)
    assert in_box(np.array([box[0] - 1e-9, box[1] + 1e-9]), parts.reshape(-1, 3)).all()
    whole = area_normals(corners.astype(float))
    for triangle in range(60):
        here = area_normals(parts[of == triangle])
        area = np.linalg.norm(whole[triangle])
        assert (here @ whole[triangle] >= -1e-9).all()
        root, v = np.sqrt(rng.random((20000, 1))), rng.random((20000, 1))
        a, b, c = corners[triangle]
        inside = in_box(box, a + root * (1 - v) * (b - a) + root * v * (c - a)).mean()
        assert abs(np.linalg.norm(here, axis=1).sum() / area - inside) < 0.02


def test_triangles_inside_stay_and_those_outside_go():
    inside = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], np.float32)
    parts, of = clipped(np.concatenate([inside + 5, inside]), np.array([[-1.0] * 3, [2.0] * 3]))
    np.testing.assert_array_equal(parts, inside)
    assert of.tolist() == [1]
