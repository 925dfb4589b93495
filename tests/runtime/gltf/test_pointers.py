"""Each problem names the property at fault, not an object that is related to it."""

import numpy as np
import pytest
from gltf_files import put, rich_scene, with_nodes, write

from gsgi.runtime.errors import SceneError
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

PRIMITIVE, LIGHT = "/meshes/0/primitives/0", "/extensions/KHR_lights_punctual/lights/0"
INSTANCES = "/nodes/2/extensions/EXT_mesh_gpu_instancing/attributes"
TANGENT, JOINTS = 6, 7  # accessors of the rich scene
# What is changed, to which value, and where the problem is. None: there.
FAULTS = [
    (f"{PRIMITIVE}/attributes/POSITION", 2, None),  # of another type
    (f"{PRIMITIVE}/attributes/TEXCOORD_0", 0, None),
    (f"{PRIMITIVE}/attributes/COLOR_0", 2, None),
    (f"{PRIMITIVE}/attributes/TANGENT", 1, None),
    (f"{PRIMITIVE}/attributes/JOINTS_0", 0, None),
    (f"{PRIMITIVE}/attributes/JOINTS_0", TANGENT, None),
    (f"{PRIMITIVE}/attributes/WEIGHTS_0", 0, None),
    (f"{PRIMITIVE}/attributes/WEIGHTS_0", JOINTS, None),  # integers that are not normalized
    (f"{PRIMITIVE}/attributes/NORMAL", 99, None),
    (f"{PRIMITIVE}/indices", 0, None),
    ("/accessors/3/componentType", 5122, f"{PRIMITIVE}/indices"),
    (f"{PRIMITIVE}/targets/0/POSITION", 2, None),
    (f"{INSTANCES}/TRANSLATION", 2, None),
    ("/skins/0/inverseBindMatrices", 0, None),
    ("/accessors/0/type", "VEC9", None),
    ("/accessors/0/componentType", 1, None),
    ("/accessors/1/byteOffset", 1, None),
    ("/accessors/1/byteOffset", 1000, None),
    ("/accessors/1/byteOffset", 4, "/accessors/1"),
    ("/accessors/0/sparse/values/byteOffset", 1, None),
    ("/bufferViews/0/byteStride", 8, "/accessors/0"),
    ("/bufferViews/0/byteStride", 13, None),
    ("/bufferViews/0/byteLength", 10**6, None),
    ("/bufferViews/0/byteOffset", 10**6, None),
    ("/nodes/1/matrix", np.eye(4).reshape(-1).tolist(), None),
    ("/nodes/1/scale", [1, 1], None),
    ("/cameras/0/perspective/yfov", 0, None),
    ("/cameras/0/perspective/znear", 0, None),
    (f"{LIGHT}/spot/outerConeAngle", 0, None),
    ("/images/0", {}, None),
]


def refused(tmp_path, document, data) -> str:
    """The pointer of the reader's error; `validate` must find an error there, too."""
    path = write(tmp_path / "a.glb", document, data)
    with pytest.raises(SceneError) as error:
        read_gltf(path)
    assert error.value.pointer in {problem.pointer for problem in validate(path) if problem.severity == "error"}
    assert str(error.value).startswith(f"{path}: {error.value.pointer}: ")
    return error.value.pointer


@pytest.mark.parametrize(("pointer", "value", "place"), FAULTS)
def test_the_property_at_fault(tmp_path, pointer, value, place):
    document, data = rich_scene()
    assert refused(tmp_path, put(document, pointer, value), data) == (place or pointer)


@pytest.mark.parametrize(("name", "values", "place"), [
    ("index", np.uint16([9]), f"{PRIMITIVE}/indices"),
    ("JOINTS_0", np.uint8([7]), f"{PRIMITIVE}/attributes/JOINTS_0"),
    ("WEIGHTS_0", np.float32([-1]), f"{PRIMITIVE}/attributes/WEIGHTS_0"),
    ("POSITION", np.float32([np.nan]), "/accessors/0"),
])  # fmt: skip
def test_the_reference_to_values_at_fault(tmp_path, name, values, place):
    document, data = rich_scene()
    primitive = document["meshes"][0]["primitives"][0]
    accessor = document["accessors"][{"index": primitive["indices"], **primitive["attributes"]}[name]]
    start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    data = data[:start] + values.tobytes() + data[start + values.nbytes :]
    assert refused(tmp_path, document, data) == place


def test_a_node_whose_joints_are_not_in_its_scene(tmp_path):
    document, data = rich_scene()
    document["nodes"][0]["children"] = [2]
    assert refused(tmp_path, document, data) == "/nodes/0/skin"


def test_a_node_that_moves_a_mesh_too_far(tmp_path):
    far = {"mesh": 0, "translation": [1e39, 0, 0]}
    assert refused(tmp_path, *with_nodes({"children": [1, 2]}, {"mesh": 0}, far)) == "/nodes/2"


def test_a_primitive_with_other_morph_targets(tmp_path):
    document, data = rich_scene()
    first = document["meshes"][0]["primitives"][0]
    document["meshes"][0]["primitives"].append({**first, "targets": first["targets"] * 2})
    assert refused(tmp_path, document, data) == "/meshes/0/primitives/1/targets"


@pytest.mark.parametrize(
    ("nodes", "cycle"),
    [
        ([{"children": [3]}, {}, {"children": [2]}, {}], 2),
        ([{"mesh": 0}, {}, {"children": [1, 3]}, {"children": [4]}, {"children": [2]}], 2),  # node 1 is below it
    ],
)
def test_a_node_of_the_cycle_itself(tmp_path, nodes, cycle):
    pointer = refused(tmp_path, *with_nodes(*nodes))
    assert pointer == f"/nodes/{cycle}"
