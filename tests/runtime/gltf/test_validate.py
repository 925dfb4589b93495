"""Validation: all problems at once, each with its code and place, and never another exception."""

import argparse
import json

import numpy as np
import pytest
from compressed_files import MESHOPT
from gltf_files import put, quad_scene, rich_scene, write

from gsgi.baker.cli.commands import validate as validate_command
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.gltf.problems import Code
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate


def found(path, severity: str = "error") -> dict[str, str]:
    """Codes by pointer."""
    return {problem.pointer: problem.code for problem in validate(path) if problem.severity == severity}


def test_a_good_file_has_no_errors(tmp_path):
    assert validate(write(tmp_path / "a.glb", *quad_scene())) == []
    path = write(tmp_path / "b.glb", *rich_scene())
    problems = validate(path)
    assert {problem.severity for problem in problems} == {"warning"}
    assert {problem.code for problem in problems} == {Code.FROZEN, Code.TRANSPARENT}
    scene = read_gltf(path)
    assert sorted(f"{path}: {problem.pointer}: {problem.message}" for problem in problems) == sorted(scene.warnings)


def test_all_problems_at_once(tmp_path):
    document, data = rich_scene()
    broken = {
        "/asset/version": (1, Code.JSON_TYPE),
        "/extensionsRequired": (["EXT_of_the_future"], None),
        "/accessors/1/count": (10**6, None),
        "/bufferViews/2/byteOffset": (10**6, None),
        "/images/0/bufferView": (0, None),
        "/samplers/0/wrapS": (1, Code.VALUE_RANGE),
        "/textures/0/source": (8, Code.INDEX_RANGE),
        "/materials/0/alphaMode": ("GLASS", Code.VALUE_RANGE),
        "/materials/1/name": (5, Code.JSON_TYPE),
        "/skins/0/joints/0": (77, Code.INDEX_RANGE),
        "/nodes/1/rotation": ([0, 0, 0, 0], Code.VALUE_RANGE),
        "/nodes/2/mesh": (-1, Code.VALUE_RANGE),
        "/cameras/0/type": ("fisheye", Code.VALUE_RANGE),
        "/extensions/KHR_lights_punctual/lights/0/intensity": (-1, Code.VALUE_RANGE),
        "/scenes/0/nodes": ([0, 9], None),
    }
    for pointer, (value, _) in broken.items():
        document = put(document, pointer, value)
    errors = found(write(tmp_path / "a.glb", document, data))
    expected = {pointer: code for pointer, (_, code) in broken.items() if code is not None} | {
        "/extensionsRequired/0": Code.UNSUPPORTED_EXTENSION,
        "/accessors/1": Code.BOUNDS,
        "/bufferViews/2/byteOffset": Code.BOUNDS,
        "/images/0": Code.IMAGE,
        "/scenes/0/nodes/1": Code.INDEX_RANGE,
    }
    assert expected.items() <= errors.items()


def test_each_problem_once(tmp_path):
    document, data = quad_scene()
    document["meshes"][0]["primitives"] *= 3
    problems = validate(write(tmp_path / "a.glb", put(document, "/accessors/0/count", 10**6), data))
    assert [problem.pointer for problem in problems] == ["/accessors/0"]
    assert problems[0].message.startswith("expected elements within a bufferView of 48 bytes, got ")


def test_parts_that_no_mesh_uses_count_too(tmp_path):
    document, data = quad_scene()
    document["materials"].append({"alphaMode": 7})
    path = write(tmp_path / "a.glb", document, data)
    read_gltf(path)
    assert found(path) == {}
    assert found(path, "warning") == {"/materials/1/alphaMode": Code.JSON_TYPE}
    assert validate(path)[0].message.endswith("got 7 (the default scene does not use it)")
    assert found(write(path, put(document, "/scene", 9), data)) == {
        "/scene": Code.INDEX_RANGE,
        "/materials/1/alphaMode": Code.JSON_TYPE,
    }


@pytest.mark.parametrize("extensions", [{}, {MESHOPT: {"fallback": True}}, {MESHOPT: {}}])
def test_buffers_without_data_are_placeholders(tmp_path, extensions):
    document, data = quad_scene()
    document["buffers"].append({"byteLength": 99, "extensions": extensions})
    assert validate(write(tmp_path / "a.glb", document, data)) == []
    read = put(document, "/bufferViews/0/buffer", 1)
    assert found(write(tmp_path / "b.glb", read, data)) == {"/buffers/1": Code.MISSING}


def test_a_glb_of_placeholders_alone(tmp_path):
    document = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": 1}]}
    assert found(write(tmp_path / "a.gltf", json.dumps(document).encode())) == {"": Code.NO_TRIANGLES}


@pytest.mark.parametrize("dense", [True, False])
def test_sparse_values_are_finite(tmp_path, dense):
    document, data = rich_scene()
    values = document["accessors"][0]["sparse"]["values"]["bufferView"]
    if not dense:
        del document["accessors"][0]["bufferView"]
    start = document["bufferViews"][values]["byteOffset"]
    data = data[:start] + np.float32(np.nan).tobytes() + data[start + 4 :]
    document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 1
    document["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = 1
    document["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = 1
    path = write(tmp_path / "a.glb", document, data)
    assert found(path)["/accessors/0"] == Code.NON_FINITE  # though no mesh uses it


@pytest.mark.parametrize(
    ("content", "code"),
    [(b"", Code.CONTAINER), (b"{", Code.JSON_SYNTAX), (b"[]", Code.CONTAINER), (b"{}", Code.MISSING)],
)
def test_files_that_do_not_open(tmp_path, content, code):
    (problem,) = validate(write(tmp_path / "a.gltf", content))
    assert (problem.severity, problem.code) == ("error", code)
    assert str(tmp_path) not in problem.message


def test_a_file_that_is_absent(tmp_path):
    (problem,) = validate(tmp_path / "a.gltf")
    assert problem.code == Code.FILE


def test_arrays_that_are_none(tmp_path):
    document, data = quad_scene()
    for kind in ("meshes", "nodes", "materials", "images"):
        errors = found(write(tmp_path / "a.glb", put(document, f"/{kind}", {"a": 1}), data))
        assert errors[f"/{kind}"] == Code.JSON_TYPE


def test_limits_reach_validation(tmp_path):
    path = write(tmp_path / "a.glb", *quad_scene())
    (problem,) = validate(path, Limits(elements=9))
    assert (problem.code, problem.pointer) == (Code.LIMIT, "/nodes/0")
    assert "--limit elements=N" in problem.message


def test_scenes_without_triangles(tmp_path):
    document, data = quad_scene()
    document["materials"].append({"alphaMode": "BLEND"})  # which nothing uses
    path = write(tmp_path / "a.glb", put(document, "/scenes/0/nodes", []), data)
    assert found(path) == {"": Code.NO_TRIANGLES}
    assert validate(path)[0].message == "expected a scene with triangles, got none with an area"


def test_only_what_is_used_is_warned_of(tmp_path):
    document, data = quad_scene()
    document["materials"].append({"alphaMode": "BLEND"})
    assert validate(write(tmp_path / "a.glb", document, data)) == []


# The command


def test_the_command(tmp_path, capsys):
    command = argparse.ArgumentParser()
    validate_command.add(command.add_subparsers())
    document, data = quad_scene()
    good = str(write(tmp_path / "good.glb", document, data))
    bad = str(write(tmp_path / "bad.glb", put(document, "/materials/0/alphaMode", 7), data))

    def run(*arguments) -> tuple[int, str]:
        options = command.parse_args(["validate", *arguments])
        return options.run(options), capsys.readouterr().out

    assert run(good) == (0, f"{good}: 0 errors, 0 warnings\n")
    assert run(good, "--json") == (0, "[]\n")
    code, text = run(bad)
    assert (code, text.splitlines()[0].split(": ")[0]) == (3, "error JSON_TYPE /materials/0/alphaMode")
    code, text = run(bad, "--json")
    assert (code, [problem["code"] for problem in json.loads(text)]) == (3, ["JSON_TYPE"])
    assert run(good, "--limit", "elements=9")[0] == 3
    code, text = run(str(tmp_path / "absent.glb"), "--json")
    assert (code, [problem["code"] for problem in json.loads(text)]) == (2, ["FILE"])
