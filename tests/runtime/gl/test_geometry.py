"""Batches: what is uploaded and compiled is what the material calls for."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gl import gbuffer, shadow
from gsgi.runtime.gl.geometry import Geometry, texture_size
from gsgi.runtime.gl.permutations import defines
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Light, Material, Scene, Texture, TextureSlot

GREY = Texture(np.full((2, 2, 4), 128, np.uint8))
SUN = Light("directional", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]))


def batches(gl, *meshes, material=scenes.WHITE, textures=()):
    geometry = Geometry(gl, Scene(meshes, (material,), textures))
    geometry.release()
    return geometry.batches


def test_a_plain_mesh_uploads_positions_and_normals_alone(gl):
    (batch,) = batches(gl, replace(scenes.floor(), color=None, tangent=np.ones((4, 4), np.float32)))
    assert set(batch.attributes) == {"position", "normal"}
    assert not any(defines("frame/gbuffer", batch.triangles()).values())


def test_an_unlit_material_samples_its_base_color_alone(gl):
    slot = TextureSlot(0)
    material = Material("", (1, 1, 1, 1), slot, 1.0, slot, slot, 1.0, (1, 1, 1), slot, unlit=True)
    (batch,) = batches(gl, scenes.floor(), material=material, textures=(GREY,))
    assert set(batch.attributes) == {"position", "normal", "base_uv"}
    assert {name for name, on in defines("frame/gbuffer", batch.triangles()).items() if on} == {"BASE_TEXTURE", "UNLIT"}


def test_meshes_with_and_without_colors_are_two_batches(gl):
    colored = replace(scenes.floor(), color=np.ones((4, 4), np.float32))
    plain, tinted = batches(gl, colored, scenes.floor(), colored, scenes.floor(), scenes.floor())
    assert "color" not in plain.attributes
    assert tinted.triangles().colored
    assert plain.material is tinted.material


def test_slots_of_one_channel_share_a_buffer(gl):
    material = Material(base_color_texture=TextureSlot(0), metallic_texture=TextureSlot(0, 1),
                        emission_texture=TextureSlot(0))  # fmt: skip
    mesh = replace(scenes.floor(), uv=np.zeros((4, 2, 2), np.float32))
    (batch,) = batches(gl, mesh, material=material, textures=(GREY,))
    assert batch.attributes["base_uv"] is batch.attributes["emission_uv"]
    assert batch.attributes["base_uv"] is not batch.attributes["metallic_uv"]


def test_a_plain_scene_compiles_no_effect(gl, monkeypatch):
    compiled = []
    for module in (gbuffer, shadow):
        compile_it = module.program
        monkeypatch.setattr(
            module, "program", lambda ctx, name, f=compile_it, **d: compiled.append((name, d)) or f(ctx, name, **d)
        )
    DeferredRenderer(gl, scenes.lit_floor(SUN), None, 8, 8).release()
    assert sorted(name for name, _ in compiled) == ["frame/gbuffer", "frame/shadow"]
    assert not any(on for _, defines in compiled for on in defines.values())


def test_a_texture_larger_than_the_driver_holds_is_unsupported(gl):
    limit = gl.info["GL_MAX_TEXTURE_SIZE"]
    with pytest.raises(UnsupportedError, match=f"{limit + 1} x 1 px: this driver's limit is {limit}"):
        texture_size(gl, np.empty((1, limit + 1, 4), np.uint8))
