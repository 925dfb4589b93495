"""Digests: equal for equal values in every process, different for whatever light depends on."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
import scenes

from gsgi.baker.cache.digest import digest, scene_digest
from gsgi.runtime.scene import Environment, Light, Texture, TextureSlot


def test_different_values_have_different_digests():
    a = np.arange(6, dtype=np.float32)
    values = [
        *(a, a.reshape(2, 3), a.reshape(3, 2), a.astype(np.float64), a + 1, a[:0], a[:0].reshape(0, 3), a.tolist()),
        *(0, 0.0, False, None, "", "0", [], {}, {"a": 1}, {"a": 2}, {"b": 1}, [[1], 2], [1, [2]], [1, 2]),
        *(float("inf"), 1e-300, 0.1, np.nextafter(0.1, 1)),
    ]
    digests = [digest(value) for value in values]
    assert len(set(digests)) == len(digests)


def test_equal_values_have_equal_digests():
    a = np.arange(6, dtype=np.float32).reshape(2, 3)
    assert digest(a) == digest(np.asfortranarray(a)) == digest(a.copy())
    assert digest([a, a]) == digest([a, a.copy()]) != digest([a, a + 1])
    assert digest({"a": 1, "b": (2, np.float64(3))}) == digest({"b": [2, 3.0], "a": 1})
    with pytest.raises(TypeError, match="set"):
        digest({1, 2})


def test_the_digest_is_the_same_in_another_process():
    code = "from gsgi.baker.cache.digest import digest; print(digest({'a': [1, 0.1, None], 'b': 'x'}))"
    environment = os.environ | {"PYTHONHASHSEED": "1"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.strip() == digest({"b": "x", "a": [1, 0.1, None]})


def test_a_scene_is_known_by_all_that_light_depends_on():
    lamp = Light("point", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    texture = Texture(np.zeros((2, 2, 4), np.uint8))
    scene = dataclasses.replace(scenes.lit_floor(lamp), textures=(texture,))
    mesh, material, replace = scene.meshes[0], scene.materials[0], dataclasses.replace
    others = [
        replace(scene, meshes=(replace(mesh, position=mesh.position + np.float32(1e-6)),)),
        replace(scene, meshes=(replace(mesh, triangle=mesh.triangle[::-1]),)),
        replace(scene, meshes=(replace(mesh, color=np.ones((4, 4), np.float32)),)),
        replace(scene, materials=(replace(material, double_sided=True),)),
        replace(scene, materials=(replace(material, base_color_texture=TextureSlot(0)),)),
        replace(scene, textures=(replace(texture, pixels=texture.pixels + np.uint8(1)),)),
        replace(scene, textures=(replace(texture, wrap=("clamp", "repeat")),)),
        replace(scene, lights=(replace(lamp, range=5.0),)),
        replace(scene, lights=()),
        replace(scene, environment=Environment(np.ones((1, 1, 3), np.float32))),
        replace(scene, environment=Environment(np.ones((1, 1, 3), np.float32), rotation=1.0)),
    ]
    digests = {scene_digest(other) for other in [scene, *others]}
    assert len(digests) == 1 + len(others)
    assert scene_digest(replace(scene, cameras={}, warnings=("something",))) == scene_digest(scene)
