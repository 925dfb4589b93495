"""Faces on each other: those that nobody sees are left out, the others are moved apart."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from scipy.spatial.transform import Rotation

from gsgi.baker.trace import duplicates
from gsgi.baker.trace.overlaps import APART, apart
from gsgi.baker.trace.planes import ROUNDING
from gsgi.baker.trace.surface_tables import tabulate
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.scene import Material, Mesh, Scene

GREY = Material("grey", (0.5, 0.5, 0.5, 1.0))
LAMP = Material("lamp", (0.0, 0.0, 0.0, 1.0), emission=(1.0, 1.0, 1.0))
MATERIALS = GREY, LAMP, replace(GREY, double_sided=True), replace(LAMP, double_sided=True)
PLAIN, LIT, TWO_SIDED, TWO_SIDED_LIT = range(4)
TILTED = Rotation.random(random_state=1).as_matrix()


def face(material: int, back: bool = False, half: float = 1.0) -> Mesh:
    mesh = scenes.floor(half, 0.0, material)
    return replace(mesh, triangle=mesh.triangle[:, ::-1].copy(), normal=-mesh.normal) if back else mesh


def small(material: int, back: bool = False) -> Mesh:
    """A face with other corners in the same plane."""
    return face(material, back, 0.4)


def scene(*meshes: Mesh, turn: np.ndarray = np.eye(3)) -> Scene:  # noqa: B008 (never changed)
    turned = (replace(m, position=(m.position @ turn.T).astype(np.float32), normal=m.normal @ turn.T) for m in meshes)
    return Scene(tuple(turned), MATERIALS)


@pytest.mark.parametrize(
    ("materials", "backs", "kept"),
    [
        ((PLAIN, PLAIN), (0, 0), [0]),
        ((PLAIN, PLAIN), (0, 1), [0, 1]),
        ((PLAIN, LIT), (0, 0), [1]),
        ((LIT, PLAIN, LIT), (0, 0, 0), [0]),
        ((TWO_SIDED, PLAIN), (0, 1), [0]),
        ((PLAIN, TWO_SIDED), (0, 0), [0, 1]),
        ((TWO_SIDED, LIT), (0, 0), [0, 1]),
        ((TWO_SIDED, LIT), (0, 1), [0, 1]),
        ((TWO_SIDED_LIT, PLAIN, PLAIN), (0, 0, 1), [0]),
    ],
)
def test_each_side_shows_one_of_the_triangles_with_the_same_corners(materials, backs, kept):
    """A lit one, else the first, of those whose front it is or that have two sides."""
    position = np.float32([[0, 0, 0], [1, 0, 0], [-0.0, 1, 0], [5, 5, 5]])
    triangle = np.uint32([[2, 0, 1] if k % 2 else [0, 1, 2] for k in range(len(backs))])
    triangle = np.where(np.array(backs, bool)[:, None], triangle[:, ::-1], triangle)
    lit = np.array([material in (LIT, TWO_SIDED_LIT) for material in materials])
    two_sided = np.array([material in (TWO_SIDED, TWO_SIDED_LIT) for material in materials])
    np.testing.assert_array_equal(duplicates.visible(position, triangle, lit, two_sided), kept)


def test_triangles_that_share_corners_but_not_all_stay():
    position = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    triangle = np.uint32([[0, 1, 2], [1, 3, 2], [0, 1, 3]])
    no = np.zeros(3, bool)
    np.testing.assert_array_equal(duplicates.visible(position, triangle, no, no), [0, 1, 2])
    assert len(duplicates.visible(position, triangle[:0], no[:0], no[:0])) == 0


def heights(*meshes: Mesh, turn: np.ndarray = np.eye(3)) -> list[float]:  # noqa: B008 (never changed)
    """How far each mesh is moved along +Y, in the error with which rays meet it."""
    surfaces = tabulate(scene(*meshes, turn=turn))
    moved, most = apart(surfaces)
    first = np.cumsum([0, *(len(mesh.triangle) for mesh in meshes[:-1])])
    before, after = (s.position[s.triangle].astype(float).mean(axis=1)[first] @ turn[:, 1] for s in (surfaces, moved))
    assert np.abs(after - before).max() <= 1.01 * most
    return list((after - before) / most) if most else [0.0] * len(meshes)


@pytest.mark.parametrize("turn", [np.eye(3), TILTED])
def test_faces_on_each_other_move_to_their_fronts_and_lamps_twice_as_far(turn):
    assert heights(face(PLAIN), small(PLAIN, back=True), turn=turn) == pytest.approx([1, -1], abs=0.2)
    assert heights(face(PLAIN), small(LIT), turn=turn) == pytest.approx([0.5, 1], abs=0.1)
    assert heights(face(TWO_SIDED), small(LIT, back=True), turn=turn) == pytest.approx([0, -1], abs=0.1)
    assert heights(face(PLAIN, back=True), small(TWO_SIDED_LIT), turn=turn) == pytest.approx([-0.5, -1], abs=0.1)


@pytest.mark.parametrize("turn", [np.eye(3), TILTED])
def test_of_lamps_on_each_other_each_covers_the_next(turn):
    """Each is at a height of its own, the one-sided highest, else the first."""
    assert heights(face(LIT), small(LIT), turn=turn) == pytest.approx([1, 0], abs=0.1)
    assert heights(face(LIT), small(LIT), face(LIT, half=0.7), turn=turn) == pytest.approx([1, 0.75, 0], abs=0.1)
    assert heights(small(TWO_SIDED_LIT), face(TWO_SIDED_LIT, back=True), turn=turn) == pytest.approx([1, 0], abs=0.1)
    assert heights(face(TWO_SIDED_LIT), small(LIT), turn=turn) == pytest.approx([2 / 3, 1], abs=0.1)
    assert heights(face(TWO_SIDED_LIT, back=True), small(LIT), turn=turn) == pytest.approx([2 / 3, 1], abs=0.1)


def test_what_lies_on_nothing_or_on_its_like_stays():
    assert heights(face(PLAIN), small(PLAIN)) == [0, 0]
    assert heights(face(TWO_SIDED), small(TWO_SIDED, back=True)) == [0, 0]
    above = replace(small(PLAIN, back=True), position=small(PLAIN).position + np.float32([0, 1e-3, 0]))
    assert heights(face(PLAIN), above) == [0, 0]
    surfaces = tabulate(scene(*scenes.box()))
    assert apart(surfaces) == (surfaces, 0.0)


def test_a_move_is_a_few_errors_of_rays():
    far = [replace(m, position=m.position + np.float32([0, 100, 0])) for m in (face(PLAIN), small(LIT))]
    _, most = apart(tabulate(scene(*far)))
    assert most == pytest.approx(2 * APART * ROUNDING * 100, rel=0.1)


@pytest.mark.parametrize("lower", [face(PLAIN, back=True), small(PLAIN, back=True)])
@pytest.mark.parametrize("turn", [np.eye(3), TILTED])
def test_a_camera_sees_a_sheet_of_two_faces_from_either_side(lower, turn):
    tracer = Tracer(scene(face(PLAIN), lower, turn=turn))
    for side in (1, -1):
        camera = look_at(turn @ [0.1, side, 0.05], np.zeros(3), turn @ [1.0, 0, 0], 0.3, 0.01)
        assert tracer.surface(camera, 32, 32).valid.all()
