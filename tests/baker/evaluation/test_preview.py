"""Pictures of a fit: the fit above, path tracing below, one column for each held-out view."""

from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from gsgi.baker.evaluation.preview import Preview, make_folder
from gsgi.runtime.errors import FileError
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend
from gsgi.runtime.image import read_image

SIZE = 24
BLEND = OverBlend(near=0.01)
CAMERAS = {"one": scenes.inside_camera(), "unused": scenes.above_camera(), "two": scenes.inside_camera()}
GREY, RED = np.float32([0.2, 0.2, 0.2]), np.float32([0.3, 0.0, 0.0])


def reference(colour) -> SimpleNamespace:
    """An image of one colour, half as bright again with its noise; the left column shows no B."""
    image = np.tile(colour, (SIZE, SIZE, 1))
    valid = np.ones((SIZE, SIZE), bool)
    valid[:, 0] = False
    noisy = np.where(valid[..., None], np.float32(1.5) * image, 0)
    return SimpleNamespace(indirect=noisy, clean=image, valid=valid)


def wall(colour) -> Gaussians:
    """One Gaussian that fills the view."""
    arrays = np.float32([[0, 0, 0, 1]]), np.full((1, 3), 30, np.float32), np.ones(1, np.float32)
    return Gaussians(np.float32([[0, 0, -3]]), *arrays, (colour / 0.2820948).reshape(1, 1, 3).astype(np.float32))


def drawn(folder, references, gaussians=None) -> list:
    make_folder(folder)
    preview = Preview(folder, references, CAMERAS)
    preview.draw(12, Bake(wall(GREY) if gaussians is None else gaussians, BLEND))
    return sorted(folder.iterdir())


def test_the_upper_row_is_the_fit_and_the_lower_the_reference(tmp_path):
    (path,) = drawn(tmp_path / "a" / "b", {"one": reference(GREY), "two": reference(RED)})
    assert path.name == "fit-000001-000012.png"
    image = read_image(path)
    assert image.shape == (2 * SIZE, 2 * SIZE, 3)
    upper, lower = image[:SIZE], image[SIZE:]
    inside = np.arange(2 * SIZE) % SIZE > 0
    # opacity is at most 0.99, and 8 bits are left
    np.testing.assert_allclose(upper[:, 1:SIZE], lower[:, 1:SIZE], atol=0.02)
    assert upper[:, 1 + SIZE :].min() > upper[:, 1:SIZE].max() + 0.1  # the same light; an eye that sees RED opens wider
    assert lower[:, 1 + SIZE :, 0].min() > 0.2
    assert not lower[:, 1 + SIZE :, 1:].any()
    assert not image[:, ~inside].any()  # no B there, and none is shown


def test_the_name_counts_the_gaussians_of_both_levels(tmp_path, monkeypatch):
    monkeypatch.setattr("gsgi.baker.evaluation.preview.draw", lambda baked, camera, reference: reference.indirect)
    preview = Preview(tmp_path, {"one": reference(GREY)}, CAMERAS)
    preview.draw(7, Bake(wall(GREY), SurfaceBlend(), coarse=wall(RED)))
    assert [path.name for path in tmp_path.iterdir()] == ["fit-000002-000007.png"]


def test_each_view_has_its_own_exposure(tmp_path):
    (path,) = drawn(tmp_path, {"one": reference(GREY), "two": reference(GREY / 10)})
    lower = read_image(path)[SIZE:]
    np.testing.assert_allclose(lower[:, 1 + SIZE :], lower[:, 1:SIZE], atol=0.01)


def test_pictures_are_in_the_order_of_the_search(tmp_path):
    preview = Preview(tmp_path, {"one": reference(GREY)}, CAMERAS)
    for iteration in (100, 20, 3000):
        preview.draw(iteration, Bake(wall(GREY), BLEND))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"fit-000001-{iteration:06d}.png" for iteration in (20, 100, 3000)]


def test_no_gaussians_and_no_light_are_black(tmp_path):
    empty = Gaussians(*(np.zeros(shape, np.float32) for shape in ((0, 3), (0, 4), (0, 3), 0, (0, 1, 3))))
    (path,) = drawn(tmp_path, {"one": reference(0 * GREY)}, empty)
    assert read_image(path).shape == (2 * SIZE, SIZE, 3)
    assert not read_image(path).any()


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(FileError, match=r"file.*cannot make the folder"):
            make_folder(folder)


def test_a_folder_that_exists_keeps_what_it_holds(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert len(drawn(tmp_path, {"one": reference(GREY)})) == 2
    assert (tmp_path / "notes.txt").read_text() == "mine"
