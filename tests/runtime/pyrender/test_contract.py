"""The drop-in's errors, its sizes, and what stays on the GPU between renders."""

import subprocess
import sys

import moderngl
import numpy as np
import pytest
from gl_objects import alive
from gsgi_files import constant
from pyrender_scenes import (
    SIZE,
    empty,
    from_behind,
    material,
    quad,
    solids,
    textured,
    translation,
    with_empty_primitives,
)

from gsgi.runtime.errors import FileError, FormatError, UnsupportedError
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.pyrender import OffscreenRenderer, RenderFlags, frame, uploads

SHADOWS = RenderFlags.SHADOWS_DIRECTIONAL | RenderFlags.SHADOWS_SPOT


@pytest.fixture
def renderer(pyrender, current_again):
    result = OffscreenRenderer(*SIZE)
    yield result
    if result._ctx:
        result.delete()


def test_the_module_needs_no_pyrender():
    code = (
        "import sys; sys.modules['pyrender'] = None; import gsgi.runtime.pyrender; assert 'OpenGL' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_scene_without_a_camera(pyrender, renderer):
    with pytest.raises(ValueError, match="Cannot render scene without a camera"):
        renderer.render(pyrender.Scene())


def test_after_delete(renderer):
    renderer.delete()
    with pytest.raises(AttributeError):
        renderer.render(empty())
    with pytest.raises(AttributeError):
        renderer.delete()


def test_shadows_of_point_lights(pyrender, renderer):
    with pytest.raises(NotImplementedError, match="Shadows not implemented for point lights"):
        renderer.render(solids(), RenderFlags.SHADOWS_ALL)
    renderer.render(solids(lit=False), RenderFlags.SHADOWS_ALL)


@pytest.mark.parametrize("flag", [RenderFlags.VERTEX_NORMALS, RenderFlags.FACE_NORMALS])
def test_normals_are_not_drawn(renderer, flag):
    with pytest.raises(UnsupportedError, match="VERTEX_NORMALS"):
        renderer.render(solids(), flag)


def test_specular_glossiness(pyrender, renderer):
    scene = empty()
    scene.add(quad(material=pyrender.material.SpecularGlossinessMaterial()))
    with pytest.raises(UnsupportedError, match="SpecularGlossinessMaterial"):
        renderer.render(scene)
    assert renderer.render(scene, RenderFlags.DEPTH_ONLY).any()


def test_files_of_indirect_light(tmp_path):
    with pytest.raises(FileError, match=r"absent\.gsgi"):
        OffscreenRenderer(*SIZE, gi=tmp_path / "absent.gsgi")
    (tmp_path / "broken.gsgi").write_bytes(b"no bake")
    with pytest.raises(FormatError, match=r"broken\.gsgi"):
        OffscreenRenderer(*SIZE, gi=str(tmp_path / "broken.gsgi"))


def test_the_size_may_change(renderer):
    scene = solids()
    before, _ = renderer.render(scene)
    renderer.viewport_width, renderer.viewport_height = 50, 40.0
    color, depth = renderer.render(scene)
    assert color.shape == (40, 50, 3)
    assert depth.shape == (40, 50)
    assert (renderer.viewport_width, renderer.viewport_height) == (50, 40)
    renderer.viewport_width, renderer.viewport_height = SIZE
    assert np.array_equal(renderer.render(scene)[0], before)


@pytest.fixture
def made(monkeypatch) -> list:
    """Primitives and textures in the order of their uploads."""
    items = []

    def counted(kind):
        def upload(ctx, item):
            items.append(item)
            return kind(ctx, item)

        return upload

    monkeypatch.setattr(frame, "UploadedPrimitive", counted(uploads.UploadedPrimitive))
    monkeypatch.setattr(frame, "UploadedTexture", counted(uploads.UploadedTexture))
    return items


def test_only_what_changed_is_uploaded_again(pyrender, made, renderer):
    scene = textured()
    node = next(iter(scene.mesh_nodes))
    primitive = node.mesh.primitives[0]
    first, _ = renderer.render(scene)
    assert len(made) == 6  # a primitive and five textures
    assert np.array_equal(renderer.render(scene)[0], first)
    scene.set_pose(node, translation(0.3, 0, 0))
    moved, _ = renderer.render(scene)
    assert not np.array_equal(moved, first)
    assert len(made) == 6
    primitive.positions = primitive.positions - np.float32([0.3, 0, 0])
    back, _ = renderer.render(scene)
    assert made[6:] == [primitive]
    # Moved there and back: positions round, so that an edge may lose a sample.
    assert (np.abs(back.astype(int) - first) > 1).mean() < 0.01
    primitive.material.baseColorTexture.source = np.zeros((2, 2, 4), np.uint8)
    assert not np.array_equal(renderer.render(scene)[0], back)
    assert made[7:] == [primitive.material.baseColorTexture]


def test_what_left_the_scene_is_freed(renderer):
    scene = solids()
    full, _ = renderer.render(scene)
    removed = next(node for node in scene.mesh_nodes if node.name == "ball")
    scene.remove_node(removed)
    assert not np.array_equal(renderer.render(scene)[0], full)
    assert len(renderer._frame._primitives._held) == 2
    renderer.render(from_behind())
    assert len(renderer._frame._primitives._held) == 1


def test_two_renderers_do_not_disturb_each_other(renderer):
    other = OffscreenRenderer(40, 30)
    expected, _ = renderer.render(solids())
    small, _ = other.render(solids())
    assert np.array_equal(renderer.render(solids())[0], expected)
    assert np.array_equal(other.render(solids())[0], small)
    other.delete()
    assert np.array_equal(renderer.render(solids())[0], expected)


def test_empty_primitives_cast_no_shadow(renderer):
    """pyrender's own shadows fail there: nothing has no bounds."""
    full, _ = renderer.render(with_empty_primitives(), SHADOWS | RenderFlags.SKIP_CULL_FACES)
    assert np.array_equal(full, renderer.render(from_behind(), SHADOWS | RenderFlags.SKIP_CULL_FACES)[0])


def test_what_is_invisible_is_not_drawn(pyrender, renderer):
    scene = empty()
    mesh = quad(material=material())
    scene.add(mesh)
    assert renderer.render(scene, RenderFlags.DEPTH_ONLY).any()
    mesh.is_visible = False
    assert not renderer.render(scene, RenderFlags.DEPTH_ONLY).any()


def gl_objects(renderer) -> dict[str, int]:
    with renderer._ctx:
        return alive(renderer._ctx)


@pytest.fixture
def lit_renderer(pyrender, current_again):
    """With baked light."""
    result = OffscreenRenderer(*SIZE, gi=constant(np.array([0.2, 0.3, 0.4])))
    yield result
    result.delete()


def test_another_size_leaves_nothing_behind(lit_renderer):
    scene = solids()
    lit_renderer.render(scene, SHADOWS)
    before = gl_objects(lit_renderer)
    for width in (40, 50, SIZE[0]):
        lit_renderer.viewport_width = width
        lit_renderer.render(scene, SHADOWS)
    assert gl_objects(lit_renderer) == before


def test_release_frees_everything(pyrender, current_again):
    ctx = create_context("egl")
    before = alive(ctx)
    drawn = frame.FrameRenderer(ctx, constant(np.array([0.2, 0.3, 0.4])))
    drawn.render(textured(), SHADOWS, SIZE, 1.0, {})
    drawn.release()
    assert alive(ctx) == before
    ctx.release()


def test_a_size_that_the_driver_refuses_is_not_kept(renderer):
    scene = solids()
    expected, _ = renderer.render(scene)
    renderer.viewport_width = 10**6
    with pytest.raises(moderngl.Error):
        renderer.render(scene)
    renderer.viewport_width = SIZE[0]
    assert np.array_equal(renderer.render(scene)[0], expected)


def test_a_failed_upload_leaves_nothing_behind(renderer):
    renderer.render(empty())
    before = gl_objects(renderer)
    scene = textured()
    renderer.render(scene)
    material = next(iter(scene.mesh_nodes)).mesh.primitives[0].material
    material.emissiveTexture.source = np.zeros((1, 10**5, 3), np.uint8)
    with pytest.raises(UnsupportedError, match="texture of 100000 x 1 px: this driver's limit is"):
        renderer.render(scene)
    renderer.render(empty())
    after = gl_objects(renderer)
    assert after | {"Program": before["Program"]} == before  # programs are kept for the next scene
