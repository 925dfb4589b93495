"""Validation: all problems at once, each with its code and place, and never another exception."""

import argparse
import json
import random
import time

import numpy as np
import pytest
from compressed_files import draco_quad, meshopt_quad
from gltf_files import JUNK, NORMAL, POSITION, UV, add, encode, is_refused, pointers, put, quad_scene, write

from gsgi.baker.cli.commands import validate as validate_command
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.gltf.problems import Code
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

FUZZ_SECONDS = 2.5


def found(path, severity: str = "error") -> dict[str, str]:
    """Codes by pointer."""
    return {problem.pointer: problem.code for problem in validate(path) if problem.severity == severity}


def rich_scene() -> tuple[dict, bytes]:
    """One small file with nearly everything in it that the reader reads."""
    scene = quad_scene()
    arrays = {
        "TEXCOORD_1": (UV * 255).astype(np.uint8), "COLOR_0": np.full((4, 4), 99, np.uint8),
        "TANGENT": np.tile(np.float32([1, 0, 0, 1]), (4, 1)),
        "JOINTS_0": np.zeros((4, 4), np.uint8), "WEIGHTS_0": np.tile(np.float32([1, 0, 0, 0]), (4, 1)),
        "target": NORMAL, "bind": np.eye(4, dtype=np.float32).reshape(1, 16), "TRANSLATION": POSITION,
        "index": np.uint8([1, 2]), "value": POSITION[1:3],
    }  # fmt: skip
    index = {}
    for name, values in arrays.items():
        normalized = name in ("TEXCOORD_1", "COLOR_0")
        scene, index[name] = add(scene, values, **({"normalized": True} if normalized else {}))
    document, data = scene
    views = {name: document["accessors"][index[name]]["bufferView"] for name in ("index", "value")}
    document["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": views["index"], "componentType": 5121},
        "values": {"bufferView": views["value"]},
    }
    primitive = document["meshes"][0]["primitives"][0]
    primitive["attributes"] |= {name: index[name] for name in index if name.isupper() and name != "TRANSLATION"}
    primitive["targets"] = [{"POSITION": index["target"], "NORMAL": index["target"]}]
    document["meshes"][0]["weights"] = [0.5]
    document["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}, "indices": 3, "mode": 5, "material": 1}]})
    transform = {"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 2], "texCoord": 1}}
    document["materials"][0] |= {
        "normalTexture": {"index": 0, "scale": 2, "extensions": transform},
        "emissiveFactor": [1, 1, 1],
        "emissiveTexture": {"index": 0, "texCoord": 1},
        "alphaMode": "MASK",
        "alphaCutoff": 0.01,
    }
    glass = {"KHR_materials_transmission": {"transmissionFactor": 0.25}, "KHR_materials_unlit": {}}
    document["materials"].append({"name": "glass", "alphaMode": "BLEND", "extensions": glass})
    document["skins"] = [{"joints": [1], "inverseBindMatrices": index["bind"]}]
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": index["TRANSLATION"]}}}
    document["nodes"] = [
        {"mesh": 0, "skin": 0, "children": [1, 2]},
        {"rotation": [0, 0, 0, 1], "camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"mesh": 1, "scale": [-1, 1, 1], "extensions": instancing},
    ]
    light = {"type": "spot", "intensity": 2, "range": 3, "spot": {"outerConeAngle": 1}}
    document["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "zfar": 9}}]
    document["animations"] = [{}]
    return document, data


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
        "/bufferViews/2": Code.BOUNDS,
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
    assert found(path) == {"/materials/1/alphaMode": Code.JSON_TYPE}


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
    path = write(tmp_path / "a.glb", put(document, "/scenes/0/nodes", []), data)
    assert found(path) == {"": Code.NO_TRIANGLES}


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


# Anything at all


@pytest.mark.parametrize("scene", [rich_scene, draco_quad, meshopt_quad])
def test_mutants_are_read_exactly_if_they_validate(tmp_path, scene):
    """Damaged values: read_gltf and validate raise nothing but what they say, and agree."""
    document, data = scene()
    places, path = pointers(document), tmp_path / "a.glb"
    rng, end, refused = random.Random(21), time.monotonic() + FUZZ_SECONDS, 0
    while time.monotonic() < end:
        mutant = document
        for _ in range(rng.randint(1, 2)):
            place = rng.choice(places)
            if place in pointers(mutant):
                mutant = put(mutant, place, rng.choice(JUNK))
        write(path, mutant, data)
        broken = is_refused(read_gltf, path)
        errors = found(path)
        assert errors or not broken, json.dumps(mutant)
        refused += broken
    assert refused > 20


def test_damaged_bytes(tmp_path):
    path, rng, end = tmp_path / "a.glb", random.Random(22), time.monotonic() + FUZZ_SECONDS
    whole = encode(*rich_scene())
    while time.monotonic() < end:
        data = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        broken = is_refused(read_gltf, path)
        assert found(path) or not broken
