"""Copies of meshes that share arrays: what is read of them is what a mesh of their own would have."""

from dataclasses import replace

import numpy as np
import pytest
from gltf_files import quad_scene, with_nodes, write

from gsgi.runtime.file.fingerprint import fingerprint
from gsgi.runtime.gltf import reader
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.instance import Instance, flat
from gsgi.runtime.rebase import local_scene
from gsgi.runtime.scene import Mesh

TURN = [0.2, 0.4, -0.4, 0.8]
NODES = (
    {"children": [1, 2, 3], "rotation": TURN},
    {"mesh": 0, "name": "one", "translation": [3, 0, 1]},
    {"mesh": 0, "name": "two", "scale": [-1, 2, 0.5]},
    {"mesh": 0, "name": "flattened", "scale": [1, 1, 0]},
)


@pytest.fixture
def both(tmp_path, monkeypatch):
    """Reads a scene with meshes of their own, and with instances."""

    def read(*content):
        path = write(tmp_path / "scene.glb", *content)
        single = read_gltf(path)
        monkeypatch.setattr(reader, "COPIED", 1)
        return single, read_gltf(path)

    return read


def test_copies_have_the_arrays_of_meshes_of_their_own(both):
    single, shared = both(*with_nodes(*NODES))
    assert [type(mesh) for mesh in single.meshes] == [Mesh] * 3
    assert [type(mesh) for mesh in shared.meshes] == [Instance, Instance, Mesh]  # the last has no volume to go back to
    assert fingerprint(shared) == fingerprint(single)
    for ours, theirs in zip(shared.meshes, single.meshes, strict=True):
        assert (ours.name, ours.material) == (theirs.name, theirs.material)
        for mesh in (ours, flat(ours)):
            np.testing.assert_array_equal(mesh.position, theirs.position)
            np.testing.assert_array_equal(mesh.triangle, theirs.triangle)
            np.testing.assert_array_equal(mesh.uv, theirs.uv)
            np.testing.assert_allclose(mesh.normal, theirs.normal, atol=1e-6)
            np.testing.assert_allclose(mesh.areas(), theirs.areas(), rtol=1e-6)
            np.testing.assert_array_equal(mesh.bounds(), theirs.bounds())
    moved = local_scene(shared, np.array([1.0, 2, 3]))
    assert moved.meshes[0].shape is shared.meshes[0].shape
    np.testing.assert_allclose(moved.meshes[0].position, single.meshes[0].position - [1, 2, 3], rtol=0, atol=1e-6)


def test_tangents_are_those_of_a_mesh_of_its_own(both):
    document, data = with_nodes(NODES[0] | {"children": [1, 2]}, *NODES[1:3])
    document["materials"][0]["normalTexture"] = {"index": 0}
    single, shared = both(document, data)
    for ours, theirs in zip(shared.meshes, single.meshes, strict=True):
        np.testing.assert_allclose(ours.tangent, theirs.tangent, atol=1e-6)
        np.testing.assert_allclose(flat(ours).tangent, theirs.tangent, atol=1e-6)


def test_copies_share_one_copy_of_their_arrays(both):
    _, shared = both(*with_nodes(*NODES))
    first, second, _ = shared.meshes
    assert first.shape is second.shape
    assert first.uv is second.uv
    assert sum(array.nbytes for array in vars(first).values() if isinstance(array, np.ndarray)) == 4 * 4 * 8


def test_few_triangles_in_copies_are_meshes_of_their_own(tmp_path, monkeypatch):
    path = write(tmp_path / "scene.glb", *with_nodes(*NODES))
    monkeypatch.setattr(reader, "COPIED", 5)  # the copies of a quad have four triangles
    assert not any(isinstance(mesh, Instance) for mesh in read_gltf(path).meshes)


def test_a_mesh_in_one_place_is_no_instance(both):
    document, data = quad_scene()
    assert isinstance(both(document, data)[1].meshes[0], Mesh)


def test_a_copy_with_another_material_keeps_the_shape(both):
    shape = both(*with_nodes(*NODES))[1].meshes[1]
    other = replace(shape, material=7, name="other")
    np.testing.assert_array_equal(flat(other).position, shape.position)
    assert (flat(other).material, flat(other).name) == (7, "other")
