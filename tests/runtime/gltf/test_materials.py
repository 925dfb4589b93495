"""Materials, textures and what is left out of a scene for want of them."""

import base64

import numpy as np
import pytest
from gltf_files import PIXELS, POSITION, UV, add, encode, png, put, quad_scene, with_attributes, write

from gsgi.runtime.errors import SceneError
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.scene import Filter, TextureSlot

MATERIAL, PBR = "/materials/0", "/materials/0/pbrMetallicRoughness"


@pytest.fixture
def read(tmp_path):
    return lambda document, data, **how: read_gltf(write(tmp_path / "scene.glb", document, data), **how)


def painted(**fields) -> tuple[dict, bytes]:
    """The quad with other members of its material."""
    document, data = quad_scene()
    document["materials"][0] |= fields
    return document, data


def alpha_pixels(*alpha: int) -> tuple[dict, bytes]:
    """The quad, its texture one row of white pixels with these alphas."""
    image = np.frombuffer(png([[[255, 255, 255, value] for value in alpha]]), np.uint8)
    document, data = quad_scene()
    document["bufferViews"][4] = {"buffer": 0, "byteOffset": len(data), "byteLength": len(image)}
    document["buffers"][0]["byteLength"] = len(data) + len(image)
    return document, data + image.tobytes()


def test_material_and_texture(read):
    scene = read(*quad_scene())
    (material,), (texture,) = scene.materials, scene.textures
    assert (material.name, material.base_color, material.metallic) == ("paint", (0.5, 0.25, 1, 1), 0.25)
    assert material.slots() == (TextureSlot(0, 0),)
    assert (material.alpha_cutoff, material.double_sided, material.emission) == (None, False, (0, 0, 0))
    assert (texture.wrap, texture.nearest) == (("clamp", "mirror"), False)
    assert texture.pixels.tolist() == PIXELS


def test_external_and_embedded_images(tmp_path):
    document, data = quad_scene()
    (tmp_path / "image.png").write_bytes(png(PIXELS))
    del document["textures"][0]["sampler"]
    text = base64.b64encode(png(PIXELS)).decode()
    percent = "".join(f"%{byte:02x}" for byte in png(PIXELS))
    for uri in ("image.png", f"data:image/png;base64,{text}", f"data:image/png,{percent}"):
        document["images"] = [{"uri": uri}]
        (tmp_path / "scene.glb").write_bytes(encode(document, data))
        (texture,) = read_gltf(tmp_path / "scene.glb").textures
        assert texture.pixels.tolist() == PIXELS
        assert texture.wrap == ("repeat", "repeat")


def test_samplers(read):
    document, data = quad_scene()
    document["samplers"][0] = {"wrapT": 33071, "magFilter": 9728}
    (texture,) = read(document, data).textures
    assert (texture.wrap, texture.nearest) == (("repeat", "clamp"), True)


def test_emission_and_alpha(read):
    document, data = painted(
        emissiveFactor=[1, 0.5, 0],
        emissiveTexture={"index": 0},
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 6}},
        alphaMode="MASK",
        doubleSided=True,
    )
    document["extensionsRequired"] = document["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    scene = read(document, data)
    (material,) = scene.materials
    assert (material.emission, material.emission_texture) == ((6, 3, 0), TextureSlot(0, 0))
    assert (material.alpha_cutoff, material.double_sided) == (0.5, True)
    assert len(scene.textures) == 1
    document["materials"][0]["alphaCutoff"] = 0.25
    assert read(document, data).materials[0].alpha_cutoff == 0.25


def test_absent_metallic_factor_means_metal(read):
    document, data = quad_scene()
    for matter in ({}, {"baseColorFactor": [1, 1, 1, 1]}):
        document["materials"] = [{"pbrMetallicRoughness": matter}]
        scene = read(document, data)
        assert scene.materials[0].metallic == 1
        assert "metallicFactor is absent" in scene.warnings[0]
    del document["meshes"][0]["primitives"][0]["material"]
    assert read(document, data).materials[0].metallic == 1


def test_metallic_texture(read):
    document, data = quad_scene()
    document["materials"] = [{"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}}]
    scene = read(document, data)
    assert (scene.materials[0].metallic, scene.materials[0].metallic_texture) == (1, TextureSlot(0, 0))
    assert "metallicFactor is absent" not in "".join(scene.warnings)


def test_textures_that_do_not_matter_are_not_read(read):
    document, data = quad_scene()
    document["images"].append({"uri": "https://example.org/missing.png"})
    document["textures"].append({"source": 1})
    missing = {"index": 1}
    unseen = [
        {"pbrMetallicRoughness": {"metallicFactor": 0, "metallicRoughnessTexture": missing}},
        {"emissiveTexture": missing},
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "baseColorTexture": missing}},
        {"extensions": {"KHR_materials_unlit": {}}, "emissiveFactor": [1, 1, 1], "emissiveTexture": missing,
         "normalTexture": missing},
        {"occlusionTexture": missing},
    ]  # fmt: skip
    for material in unseen:
        scene = read({**document, "materials": [material]}, data)
        assert (scene.materials[0].slots(), scene.textures) == ((), ())
        assert scene.meshes[0].uv.shape == (4, 0, 2)
    document["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": missing}})
    assert len(read(document, data).materials) == 1
    with pytest.raises(SceneError, match="/images/1/uri"):
        read(put(document, f"{PBR}/baseColorTexture/index", 1), data)


def test_unlit(read):
    scene = read(*painted(extensions={"KHR_materials_unlit": {}}, emissiveFactor=[1, 1, 1]))
    (material,) = scene.materials
    assert (material.unlit, material.metallic, material.emission) == (True, 0, (0, 0, 0))
    assert material.base_color_texture == TextureSlot(0, 0)


def test_specular_glossiness_counts_by_its_diffuse_part(read):
    glossy = {"diffuseFactor": [0.1, 0.2, 0.3, 1], "diffuseTexture": {"index": 0}, "specularFactor": [1, 1, 1]}
    scene = read(*painted(extensions={"KHR_materials_pbrSpecularGlossiness": glossy}))
    (material,) = scene.materials
    assert (material.base_color, material.metallic) == ((0.1, 0.2, 0.3, 1), 0)
    assert material.base_color_texture == TextureSlot(0, 0)
    assert "only diffuse factors" in scene.warnings[0]


# Texture coordinates


def test_a_channel_for_each_set_and_transform(read):
    scene, second = add(quad_scene(), UV * 2)
    document, data = scene
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = second
    moved = {"KHR_texture_transform": {"offset": [0.25, 0.5], "texCoord": 1}}
    document["materials"][0] |= {
        "emissiveFactor": [1, 1, 1],
        "emissiveTexture": {"index": 0, "extensions": moved},
        "normalTexture": {"index": 0, "texCoord": 1, "scale": 0.5},
    }
    document["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 0, "texCoord": 0}
    read_scene = read(document, data)
    (material,), (mesh,) = read_scene.materials, read_scene.meshes
    assert material.base_color_texture == material.metallic_texture == TextureSlot(0, 0)
    assert (material.normal_texture, material.normal_scale) == (TextureSlot(0, 1), 0.5)
    assert material.emission_texture == TextureSlot(0, 2)
    np.testing.assert_array_equal(mesh.uv, np.stack([UV, 2 * UV, 2 * UV + np.float32([0.25, 0.5])], axis=1))
    assert len(read_scene.textures) == 1


def test_transforms_scale_then_rotate_then_move(read):
    # A quarter counter-clockwise, v pointing down, takes (u, 0) to (0, -u) and (0, v) to (v, 0).
    transform = {"offset": [10, 20], "rotation": np.pi / 2, "scale": [2, 3]}
    document, data = quad_scene()
    info = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["extensions"] = {"KHR_texture_transform": transform}
    (mesh,) = read(document, data).meshes
    expected = np.stack([10 + 3 * UV[:, 1], 20 - 2 * UV[:, 0]], axis=1)
    np.testing.assert_allclose(mesh.uv[:, 0], expected, atol=1e-5)


def test_one_layout_for_all_primitives_of_a_material(read):
    document, data = quad_scene()
    bare = {"attributes": {"POSITION": 0}, "indices": 3, "material": 0}
    document["meshes"][0]["primitives"].append(bare)
    scene = read(document, data)
    assert [mesh.uv.shape for mesh in scene.meshes] == [(4, 1, 2), (6, 1, 2)]
    assert not scene.meshes[1].uv.any()
    assert "/meshes/0/primitives/1: TEXCOORD_0 is absent and counts as 0" in scene.warnings[0]


def test_transforms_that_overflow(read):
    document, data = with_attributes({"TEXCOORD_0": UV * np.float32(1e38)})
    info = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["extensions"] = {"KHR_texture_transform": {"scale": [100, 1]}}
    with pytest.raises(SceneError, match="/meshes/0/primitives/0: expected texture coordinates that float32 holds"):
        read(document, data)


# Transparency


BLEND = {"alphaMode": "BLEND"}


def glass(factor: float, **fields) -> dict:
    return {"extensions": {"KHR_materials_transmission": {"transmissionFactor": factor}}, **fields}


def test_opaque_ignores_alpha(read):
    document, data = alpha_pixels(0, 255)
    (material,) = read(put(document, f"{PBR}/baseColorFactor", [1, 1, 1, 0.2]), data).materials
    assert (material.base_color[3], material.alpha_cutoff) == (1, None)


@pytest.mark.parametrize(("mode", "cutoff", "count"), [("cutout", 0.5, 1), ("opaque", None, 1), ("absent", None, 0)])
def test_blended(read, mode, cutoff, count):
    document, data = alpha_pixels(0, 255)
    document["materials"][0] |= BLEND
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "indices": 3})
    scene = read(document, data, transparency=mode)
    assert len(scene.meshes) == count + 1
    stand_ins = [material for material in scene.materials if material.stand_in]
    assert [material.alpha_cutoff for material in stand_ins] == [cutoff] * count
    (mesh,) = scene.blended
    blended = scene.materials[mesh.material]
    assert (blended.stand_in, blended.alpha_cutoff, blended.base_color_texture is None) == (False, None, False)
    assert not any(material.stand_in for material in scene.as_traced().materials)
    assert not scene.as_traced().blended
    (warning,) = [warning for warning in scene.warnings if "--transparent" in warning]
    assert f'{MATERIAL}/alphaMode: "paint" is blended: ' in warning


@pytest.mark.parametrize(
    ("factor", "fields", "mode", "alpha", "cutoff"),
    [
        (0.4, {}, "cutout", 1, None),  # more opaque than not, everywhere
        (0.4, BLEND, "cutout", 0.6, 0.5),
        (0.4, {"alphaMode": "MASK", "alphaCutoff": 0.9}, "cutout", 1, 0.9),
        (0.9, BLEND, "opaque", 1, None),
        (0.9, {"alphaMode": "MASK"}, "opaque", 1, 0.5),
    ],
)
def test_transmission(read, factor, fields, mode, alpha, cutoff):
    document, data = alpha_pixels(0, 255)
    document["materials"][0] |= glass(factor, **fields)
    scene = read(document, data, transparency=mode)
    (material,) = scene.used_materials()
    assert material.base_color[3] == pytest.approx(alpha)
    assert (material.alpha_cutoff, material.stand_in) == (cutoff, True)
    blended = scene.materials[scene.blended[0].material]
    assert blended.base_color[3] == pytest.approx(1 - factor)
    assert any('"paint" transmits light: ' in warning for warning in scene.warnings)


LEAST, THIRD = pytest.approx(1 / 255), pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("fields", "mode", "passes", "cutoff"),
    [
        (BLEND, "filter", Filter(True, 0.0, False, THIRD), LEAST),
        (BLEND, "shade", Filter(True, 0.0, False), LEAST),
        (BLEND, "stain", Filter(True, 0.0, True), LEAST),
        (glass(0.75), "filter", Filter(False, 0.75, False), None),
        (glass(0.75), "stain", Filter(False, 0.75, False), None),
        (glass(0.75, **BLEND), "filter", Filter(True, 0.75, False, THIRD), LEAST),
        (glass(0.75, alphaMode="MASK", alphaCutoff=0.9), "filter", Filter(False, 0.75, False), 0.9),
    ],
)
def test_what_lets_light_through(read, fields, mode, passes, cutoff):
    document, data = alpha_pixels(0, 255)
    document["materials"][0] |= fields
    scene = read(document, data, transparency=mode)
    (material,) = scene.used_materials()
    assert (material.filter, material.alpha_cutoff, material.stand_in) == (passes, cutoff, True)
    assert scene.materials[scene.blended[0].material].filter is None
    traced = scene.as_traced()
    shown = [m for m in traced.used_materials() if not m.stand_in]
    assert [m.alpha_cutoff for m in shown] == [0.5], "cameras see through what is mostly clear"
    assert not traced.blended
    assert len(traced.meshes) == 2, "one of them for shadows alone"


@pytest.mark.parametrize(
    ("fields", "color", "mode", "clear"),
    [
        (BLEND, (1, 0.5, 0.2, 0.3), "filter", np.inf),
        (BLEND, (1, 0.5, 0.2, 0.34), "filter", 0),
        (BLEND, (1, 0.5, 0.2, 0.3), "shade", 0),
        (BLEND, (1, 0.5, 0.2, 0.3), "stain", 0),  # its blue is stained
        (BLEND, (1, 0.9, 0.9, 0.2), "stain", np.inf),
        (glass(0.8), (1, 0.9, 0.9, 1), "filter", np.inf),
        (glass(0.8), (1, 0.9, 0.9, 1), "shade", 0),
        (glass(0.7), (1, 0.9, 0.9, 1), "filter", 0),
        (glass(0.8), (1, 0.9, 0.5, 1), "filter", 0),
        (glass(0.5, **BLEND), (1, 1, 1, 0.6), "filter", np.inf),
        (glass(0.5, **BLEND), (1, 1, 1, 0.7), "filter", 0),
    ],
)
def test_panes_that_let_two_thirds_of_each_channel_through_cast_no_shadow(read, fields, color, mode, clear):
    document, data = painted(**fields, pbrMetallicRoughness={"metallicFactor": 0, "baseColorFactor": list(color)})
    (material,) = read(document, data, transparency=mode).used_materials()
    assert material.filter.clear == clear
    assert material.shadow_cutoff == (np.inf if clear else material.alpha_cutoff)


def test_a_texture_decides_where_a_pane_is_clear(read):
    document, data = alpha_pixels(40, 200)
    document["materials"][0] |= BLEND
    (material,) = read(document, data).used_materials()
    assert material.filter.clear == material.shadow_cutoff == pytest.approx(1 / 3)
    for pixels, cutoff in (((20, 60), np.inf), ((90, 200), None)):
        document, data = alpha_pixels(*pixels)
        document["materials"][0] |= BLEND
        (material,) = read(document, data).used_materials()
        assert material.shadow_cutoff == cutoff
    document, data = alpha_pixels(255, 255)
    document["materials"][0] |= glass(1)
    (material,) = read(document, data).used_materials()
    assert material.filter.clear == 0, "the texture may tint what it lets through"


@pytest.mark.parametrize(("fields", "clear"), [(glass(0.9), 0), (glass(0.5, **BLEND), THIRD), (BLEND, THIRD)])
def test_what_vertex_colours_tint_is_clear_where_it_is_open_alone(read, fields, clear):
    color = np.ones((4, 4), np.float32)
    color[:, 1] = 0.4
    color[:2, 3] = 0.2
    document, data = with_attributes({"COLOR_0": color})
    document["materials"][0] = fields
    (material,) = read(document, data).used_materials()
    assert material.filter.clear == clear
    color[:, 1] = 1
    document, data = with_attributes({"COLOR_0": color})
    document["materials"][0] = glass(0.9)
    assert read(document, data).used_materials()[0].filter.clear == np.inf


def test_clear_glass_is_nothing_to_light(read):
    document, data = painted(**glass(1), pbrMetallicRoughness={"metallicFactor": 0})
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "indices": 3})
    assert not any(material.filter for material in read(document, data).materials)
    scene = read(put(document, f"{PBR}/baseColorFactor", [1, 0.9, 1, 1]), data)
    assert [material.filter for material in scene.materials if material.stand_in] == [Filter(False, 1.0, clear=np.inf)]


@pytest.mark.parametrize("fields", [glass(0.6), glass(0.6, alphaMode="MASK"), glass(1, **BLEND)])
def test_what_is_one_hole_is_left_out(read, fields):
    document, data = painted(**fields)
    with pytest.raises(SceneError, match='expected a scene with triangles, got none that can be seen: "paint" '):
        read(document, data, transparency="cutout")
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "indices": 3})
    scene = read(document, data, transparency="cutout")
    (material,) = scene.used_materials()
    assert (len(scene.meshes), material.name, material.stand_in) == (1, "", False)
    assert len(scene.blended) == 1, "but frames show it, if only its tint"


def test_a_mask_that_cuts_everything_or_nothing(read):
    document, data = alpha_pixels(100, 120)
    document["materials"][0] |= {"alphaMode": "MASK", "alphaCutoff": 0.3}
    assert read(document, data).materials[0].alpha_cutoff is None
    document["materials"][0]["alphaCutoff"] = 0.45  # between both
    assert read(document, data).materials[0].alpha_cutoff == 0.45
    document["materials"][0]["alphaCutoff"] = 0.48
    with pytest.raises(SceneError, match="got none"):
        read(document, data)


def test_vertex_alpha_decides_too(read):
    color = np.ones((4, 4), np.float32)
    color[:, 3] = [0.1, 0.2, 0.3, 0.9]
    document, data = with_attributes({"COLOR_0": color})
    document["materials"][0] = {"alphaMode": "MASK"}
    assert read(document, data).materials[0].alpha_cutoff == 0.5
    document["materials"][0]["alphaCutoff"] = 0.1
    assert read(document, data).materials[0].alpha_cutoff is None
    document["materials"][0]["alphaCutoff"] = 0.95
    with pytest.raises(SceneError, match="got none"):
        read(document, data)


def test_pruning_renumbers_materials_and_textures(read):
    document, data = alpha_pixels(0, 0)
    image = np.frombuffer(png(PIXELS), np.uint8)
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": len(image)})
    document["buffers"][0]["byteLength"] = len(data) + len(image)
    document["images"].append({"bufferView": 5})
    document["textures"].append({"source": 1})
    hidden = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    seen = {"name": "seen", "pbrMetallicRoughness": {"baseColorTexture": {"index": 1}, "metallicFactor": 0}}
    document["materials"] = [hidden, seen]
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "indices": 3, "material": 1})
    scene = read(document, data + image.tobytes())
    assert [material.name for material in scene.materials] == ["seen"]
    assert (scene.meshes[0].material, scene.materials[0].base_color_texture.texture) == (0, 0)
    (texture,) = scene.textures
    assert texture.pixels.tolist() == PIXELS
    np.testing.assert_array_equal(scene.bounds()[1], POSITION.max(axis=0))


@pytest.mark.parametrize("name", ["EXT_texture_webp", "KHR_texture_basisu"])
def test_other_image_formats_beside_a_plain_one(read, name):
    document, data = quad_scene()
    document["images"].append({"uri": "https://example.org/missing"})
    document["textures"][0]["extensions"] = {name: {"source": 1}}
    if name == "EXT_texture_webp":
        with pytest.raises(SceneError, match="/images/1/uri"):
            read(document, data)
    else:
        scene = read(document, data)
        assert "KHR_texture_basisu is ignored" in scene.warnings[0]
        assert scene.textures[0].pixels.tolist() == PIXELS
