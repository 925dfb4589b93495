"""Skins at their rest pose, and instances of meshes."""

import numpy as np
import pytest
from gltf_files import NORMAL, POSITION, add, put, quad_scene, write

from gsgi.runtime.errors import SceneError
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.gltf.reader import read_gltf

JOINTS = np.uint8([[0, 1, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0], [1, 9, 0, 0]])  # the 9 has no weight
WEIGHTS = np.float32([[1, 0, 0, 0], [0.75, 0.25, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]])


@pytest.fixture
def read(tmp_path):
    return lambda document, data, **how: read_gltf(write(tmp_path / "scene.glb", document, data), **how)


def skinned(*joints: dict, joint_sets=(JOINTS,), weight_sets=(WEIGHTS,), bind=None) -> tuple[dict, bytes]:
    """The quad on node 0, hung up somewhere else, with its joints as nodes 1, 2, ..."""
    scene = quad_scene()
    attributes = {}
    for number, (indices, weights) in enumerate(zip(joint_sets, weight_sets, strict=True)):
        scene, attributes[f"JOINTS_{number}"] = add(scene, indices)
        scene, attributes[f"WEIGHTS_{number}"] = add(scene, weights, normalized=weights.dtype != np.float32)
    skin = {"joints": list(range(1, len(joints) + 1))}
    if bind is not None:
        scene, skin["inverseBindMatrices"] = add(scene, np.float32(bind).transpose(0, 2, 1))
    document, data = scene
    document["meshes"][0]["primitives"][0]["attributes"] |= attributes
    document["nodes"] = [{"mesh": 0, "skin": 0, "translation": [100, 0, 0]}, *joints]
    document["scenes"] = [{"nodes": list(range(len(joints) + 1))}]
    document["skins"] = [skin]
    return document, data


def moved(*offset: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def test_joints_move_vertices_by_their_weights(read):
    scene = read(*skinned({"translation": [1, 0, 0]}, {"translation": [0, 0, 4]}))
    (mesh,) = scene.meshes
    offsets = [[1, 0, 0], [0.75, 0, 1], [0, 0, 4], [0, 0, 4]]
    np.testing.assert_allclose(mesh.position, POSITION + np.float32(offsets), atol=1e-6)
    (warning,) = scene.warnings
    assert "/skins: skins stand at the rest pose" in warning


def test_inverse_bind_matrices(read):
    # Bound where they stand, the joints leave the mesh as it is; the node's own place does not count.
    joints = {"translation": [1, 2, 3]}, {"translation": [4, 5, 6]}
    bind = [moved(-1, -2, -3), moved(-4, -5, -6)]
    (mesh,) = read(*skinned(*joints, bind=bind)).meshes
    np.testing.assert_allclose(mesh.position, POSITION, atol=1e-6)
    with pytest.raises(SceneError, match="/inverseBindMatrices: expected 2 matrices, one for each joint, got 1"):
        read(*skinned(*joints, bind=bind[:1]))


def test_more_than_four_joints(read):
    halves = np.full((4, 4), 255 // 5 // 1, np.uint8) * np.uint8([1, 0, 0, 0])
    document, data = skinned(
        {"translation": [2, 0, 0]}, {"translation": [0, 4, 0]}, joint_sets=(JOINTS * 0, JOINTS * 0 + 1),
        weight_sets=(halves, halves),
    )  # fmt: skip
    (mesh,) = read(document, data).meshes  # weights count by their share
    np.testing.assert_allclose(mesh.position, POSITION + np.float32([1, 2, 0]), atol=1e-6)


def test_normals_and_winding_of_mirrored_joints(read):
    document, data = skinned({"scale": [1, 1, -1], "rotation": [0, 0.6, 0, 0.8]}, joint_sets=(JOINTS * 0,))
    (mesh,) = read(document, data).meshes
    a, b, c = mesh.position[mesh.triangle[0]]
    front = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    np.testing.assert_allclose(mesh.normal, np.tile(front, (4, 1)), atol=1e-6)
    rotated = np.array([2 * 0.6 * 0.8, 0, 1 - 2 * 0.36])  # of +Z, which the mirror has turned to -Z
    np.testing.assert_allclose(mesh.normal[0], -rotated, atol=1e-6)


@pytest.mark.parametrize(
    ("pointer", "value", "message"),
    [
        ("/skins/0/joints", [], "/skins/0/joints: expected a joint"),
        ("/skins/0/joints", [1, 7], "/skins/0/joints/1: expected an index into 3 nodes"),
        (
            "/scenes/0/nodes",
            [0, 1],
            "/nodes/0/skin: expected a skin with joints within the scene, got /skins/0/joints/1",
        ),
        ("/skins/0/joints", [1], "/attributes/JOINTS_0: expected joints below 1, got 1"),
        ("/nodes/0/skin", 3, "/nodes/0/skin: expected an index into 1 skins"),
    ],
)
def test_invalid_skins(read, pointer, value, message):
    document, data = skinned({}, {})
    with pytest.raises(SceneError) as refused:
        read(put(document, pointer, value), data)
    assert message in str(refused.value)


# Instances


def instanced(**attributes) -> tuple[dict, bytes]:
    """The quad on a node of scale 2 with EXT_mesh_gpu_instancing."""
    scene, names = quad_scene(), {}
    for name, values in attributes.items():
        scene, names[name] = add(scene, values, normalized=values.dtype != np.float32)
    extension = {"EXT_mesh_gpu_instancing": {"attributes": names}}
    node = {"mesh": 0, "scale": [2, 2, 2], "extensions": extension}
    return {
        **scene[0],
        "nodes": [node],
        "extensionsUsed": list(extension),
        "extensionsRequired": list(extension),
    }, scene[1]


@pytest.mark.parametrize(("dtype", "one"), [("f4", 1), ("i1", 127), ("i2", 32767)])
def test_instances(read, dtype, one):
    quarter = (np.array([[0, 0, 0, 1], [0, np.sqrt(0.5), 0, np.sqrt(0.5)]]) * one).astype(dtype)  # +Z to +X
    scene = read(*instanced(
        TRANSLATION=np.float32([[1, 0, 0], [0, 5, 0]]), ROTATION=quarter, SCALE=np.float32([[1, 1, 1], [1, 3, 1]])
    ))  # fmt: skip
    first, second = scene.meshes
    np.testing.assert_allclose(first.position, 2 * (POSITION + np.float32([1, 0, 0])), atol=1e-6)
    np.testing.assert_allclose(first.normal, NORMAL, atol=1e-6)
    x, y, _ = POSITION.T
    np.testing.assert_allclose(second.position, 2 * np.stack([0 * x, 5 + 3 * y, -x], axis=1), atol=1e-5)
    np.testing.assert_allclose(second.normal, np.tile([1, 0, 0], (4, 1)), atol=1e-5)
    assert first.uv is second.uv
    assert scene.warnings == ()


def test_instances_are_counted(read):
    document, data = instanced(TRANSLATION=np.zeros((10, 3), np.float32))
    assert len(read(document, data).meshes) == 10
    with pytest.raises(SceneError, match="expected at most 9 nodes and instances"):
        read(document, data, limits=Limits(nodes=9))
    with pytest.raises(SceneError, match=r"/nodes/0: expected at most 99 vertices and indices .*, got 100"):
        read(document, data, limits=Limits(elements=99))


def test_invalid_instances(read):
    lengths = {"TRANSLATION": np.zeros((2, 3), np.float32), "SCALE": np.ones((3, 3), np.float32)}
    with pytest.raises(SceneError, match=r"attributes: expected attributes of one length, got \[2, 3\]"):
        read(*instanced(**lengths))
    with pytest.raises(SceneError, match="/ROTATION: expected unit quaternions"):
        read(*instanced(ROTATION=np.zeros((2, 4), np.float32)))
    with pytest.raises(SceneError, match="attributes: expected TRANSLATION, ROTATION or SCALE"):
        read(*instanced())
