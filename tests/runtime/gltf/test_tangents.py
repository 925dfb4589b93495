"""Tangents: where u rises, on the side where glTF's green points up, under every matrix."""

import numpy as np
import pytest
from gltf_files import INDEX, NORMAL, POSITION, UV, with_attributes, write

from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.tangents import orthonormal, tangents

TRIANGLE = INDEX.reshape(-1, 3)
MIRRORED_U, ROTATED = UV * np.float32([-1, 1]), np.stack([UV[:, 1], 1 - UV[:, 0]], axis=1)


@pytest.mark.parametrize(
    ("uv", "expected"),
    [(UV, (1, 0, 0, 1)), (UV * 7 + 3, (1, 0, 0, 1)), (MIRRORED_U, (-1, 0, 0, -1)), (ROTATED, (0, -1, 0, 1))],
)
def test_a_quad(uv, expected):
    # An upright image: u to the right, v down; the bitangent w * cross(n, t) points up in the image.
    result = tangents(POSITION, NORMAL, uv.astype(np.float32), TRIANGLE)
    np.testing.assert_allclose(result, np.tile(np.float32(expected), (4, 1)), atol=1e-6)
    assert result.dtype == np.float32


def test_larger_triangles_count_for_more():
    # Two triangles share an edge; u rises along +X in the large one, along +Y in the small one.
    position = np.float32([[0, 0, 0], [0, 1, 0], [-9, 0, 0], [1, 0, 0]])
    uv = np.float32([[0, 0], [0, -1], [-9, 0], [0, 0]])
    result = tangents(position, np.tile(NORMAL[:1], (4, 1)), uv, np.array([[0, 1, 2], [0, 3, 1]]))
    assert result[0, 0] > 0.95


@pytest.mark.parametrize("uv", [np.zeros((4, 2)), np.repeat(UV[:, :1], 2, axis=1), np.full((4, 2), 1e38)])
def test_texture_coordinates_without_area(uv):
    result = tangents(POSITION, NORMAL, uv.astype(np.float32), TRIANGLE)
    np.testing.assert_allclose(np.linalg.norm(result[:, :3], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose((result[:, :3] * NORMAL).sum(axis=1), 0, atol=1e-6)


def test_orthonormal_mends_what_a_file_states():
    given = np.float32([[1, 0, 1, 0.5], [0, 0, 5, -1], [0, 0, 0, 0], [3, 4, 0, -2]])
    result = orthonormal(given, NORMAL)
    np.testing.assert_allclose(result[0], [1, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(result[3], [0.6, 0.8, 0, -1], atol=1e-6)
    np.testing.assert_allclose((result[:, :3] * NORMAL).sum(axis=1), 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(result[:, :3], axis=1), 1, atol=1e-6)


# In scenes

MAPPED = {"pbrMetallicRoughness": {"metallicFactor": 0}, "normalTexture": {"index": 0}}


@pytest.fixture
def read(tmp_path):
    def read_mapped(scene, material=MAPPED, **node):
        document, data = scene
        document["materials"] = [material]
        document["nodes"] = [{"mesh": 0, **node}]
        return read_gltf(write(tmp_path / "scene.glb", document, data)).meshes[0]

    return read_mapped


def frame(mesh) -> np.ndarray:
    """Tangent, bitangent and normal (V, 3, 3) as columns."""
    tangent, normal = mesh.tangent[:, :3], mesh.normal
    return np.stack([tangent, np.cross(normal, tangent) * mesh.tangent[:, 3:], normal], axis=2)


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, -2, 1), (-1, -1, -1), (2, 3, 4), (1, 1, -5)])
def test_mirrors_turn_given_and_computed_tangents_alike(read, scale):
    given = np.tile(np.float32([1, 0, 0, 1]), (4, 1))
    meshes = [read(with_attributes(extra), scale=scale) for extra in ({}, {"TANGENT": given})]
    # The image stays where it is on the surface: its right and its up are carried along, the normal faces the front.
    carried = np.diag(np.sign(scale)) @ np.eye(3)
    for mesh in meshes:
        np.testing.assert_allclose(frame(mesh), np.tile(carried, (4, 1, 1)), atol=1e-6)


def test_only_normal_textures_need_tangents(tmp_path):
    document, data = with_attributes({"TANGENT": np.tile(np.float32([1, 0, 0, 1]), (4, 1))})
    assert read_gltf(write(tmp_path / "scene.glb", document, data)).meshes[0].tangent is None


def test_flat_meshes_ignore_given_tangents(read):
    document, data = with_attributes({"TANGENT": np.tile(np.float32([0, 1, 0, -1]), (4, 1))})
    del document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]
    mesh = read((document, data))
    np.testing.assert_allclose(mesh.tangent, np.tile(np.float32([1, 0, 0, 1]), (6, 1)), atol=1e-6)


def test_quantized_tangents(read):
    given = np.tile(np.int8([0, 127, 0, -127]), (4, 1))
    mesh = read(with_attributes({"TANGENT": given}, normalized=("TANGENT",)))
    np.testing.assert_array_equal(mesh.tangent, np.tile(np.float32([0, 1, 0, -1]), (4, 1)))


def test_the_normal_texture_s_own_channel_counts(read):
    document, data = with_attributes({"TEXCOORD_1": ROTATED.astype(np.float32)})
    mapped = {**MAPPED, "normalTexture": {"index": 0, "texCoord": 1}}
    mapped["pbrMetallicRoughness"] = {"metallicFactor": 0, "baseColorTexture": {"index": 0}}
    mesh = read((document, data), mapped)
    np.testing.assert_allclose(mesh.tangent[0], [0, -1, 0, 1], atol=1e-6)
