"""Scenes that are valid and yet hardly meant: a warning names what will be seen, and how much of it."""

import numpy as np
import pytest
from gltf_files import BLOBS, png, put, quad_scene, with_nodes, write

from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

MATTER = "/materials/0/pbrMetallicRoughness"


@pytest.fixture
def warned(tmp_path):
    """Reads JSON and BIN chunk; returns the warnings, each as code, pointer and text, as `validate` finds them too."""

    def warnings(*content) -> list[tuple[str, str, str]]:
        path = write(tmp_path / "scene.glb", *content)
        problems = validate(path)
        assert read_gltf(path).warnings == tuple(f"{path}: {p.pointer or '/'}: {p.message}" for p in problems)
        return [(problem.code, problem.pointer, problem.message) for problem in problems]

    return warnings


# Metal


def test_a_metal_floor(warned):
    (code, pointer, text), = warned(put(quad_scene()[0], f"{MATTER}/metallicFactor", 1), quad_scene()[1])  # fmt: skip
    assert (code, pointer) == ("METAL", "/materials")
    expected = '1 m^2, 100% of all surface, is metal, most of it "paint": it has no mirror images and looks rough'
    assert text == expected


@pytest.mark.parametrize(("scale", "text"), [(1, "1 m^2, 10% of all surface"), (0.1, None)])
def test_a_metal_part_of_a_scene(warned, scale, text):
    document, data = with_nodes({"mesh": 0, "scale": [3, 3, 3], "children": [1]}, {"mesh": 1, "scale": [scale / 3] * 3})
    document["materials"].append({"name": "rail", "pbrMetallicRoughness": {"metallicFactor": 0.9}})
    primitive = document["meshes"][0]["primitives"][0]
    document["meshes"].append({"primitives": [{**primitive, "material": 1}]})
    document = put(document, f"{MATTER}/metallicFactor", 0.4)  # more than half of the light comes back
    found = [problem[2] for problem in warned(document, data)]
    assert len(found) == (text is not None)
    assert all(line.startswith(f'{text}, is metal, most of it "rail"') for line in found)


@pytest.mark.parametrize(("factor", "percent"), [(1, 50), (0.6, 25), (0.4, None)])
def test_the_texels_that_are_metal(warned, factor, percent):
    texels = np.zeros((2, 2, 4), np.uint8)
    texels[..., 2] = [[255, 200], [100, 0]]
    document, data = quad_scene((*BLOBS[:4], np.frombuffer(png(texels), np.uint8)))
    document = put(document, MATTER, {"metallicFactor": factor, "metallicRoughnessTexture": {"index": 0}})
    found = [problem[2] for problem in warned(document, data)]
    assert len(found) == (percent is not None)
    assert all(f" m^2, {percent}% of all surface, is metal" in line for line in found)


def test_black_metal_is_no_loss(warned):
    document, data = quad_scene()
    assert warned(put(document, MATTER, {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 1}), data) == []


# Size


@pytest.mark.parametrize(
    ("scale", "size"),
    [(1e-3, "1.41 mm"), (0.03, "42.4 mm"), (0.04, None), (1400, None), (1500, "2.12 km"), (1e14, "1.41e+11 km")],
)
def test_a_scene_in_another_unit(warned, scale, size):
    found = warned(*with_nodes({"mesh": 0, "scale": [scale] * 3}))
    text = "the scene is {} across: glTF counts in metres; if it was made in another unit, export it with a scale"
    assert found == ([] if size is None else [("SIZE", "", text.format(size))])
