"""Every file of the conformance folder loads as expected, or is refused for the expected reason."""

import numpy as np
import pytest
from repository import SHARED

from gsgi.runtime.errors import GsgiError
from gsgi.runtime.gltf import primitives
from gsgi.runtime.gltf.glb import open_document
from gsgi.runtime.gltf.limits import Limits
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.gltf.validate import validate

CONFORMANCE = SHARED / "conformance"
pytestmark = pytest.mark.skipif(not CONFORMANCE.is_dir(), reason="the conformance files are not beside the repository")

# Triangles and meshes, or the code of the refusal.
EXPECTED = {
    "assimp_testmodels/BoxTexcoords-glTF/boxTexcoords.gltf": (12, 1),
    "assimp_testmodels/BoxTextured-glTF-Binary/BoxTextured.glb": (12, 1),
    "assimp_testmodels/BoxTextured-glTF-Embedded/BoxTextured.gltf": (12, 1),
    "assimp_testmodels/BoxTextured-glTF/BoxTextured.gltf": (12, 1),
    "assimp_testmodels/cameras/Cameras.gltf": (2, 1),
    "assimp_testmodels/draco/2CylinderEngine.gltf": (110322, 115),
    "assimp_testmodels/simple_skin/simple_skin.gltf": (8, 1),
    "assimp_testmodels/textureTransform/TextureTransformTest.gltf": (24, 12),
    "bad_inputs_assimp/BoxBadNormals-glTF-Binary/BoxBadNormals.glb": (12, 1),
    "bad_inputs_assimp/BoxWithInfinites-glTF-Binary/BoxWithInfinites.glb": "NON_FINITE",
    "bad_inputs_assimp/IncorrectVertexArrays/Cube.gltf": (46, 4),
    "bad_inputs_assimp/IndexOutOfRange/AllIndicesOutOfRange.gltf": "INDEX_RANGE",
    "bad_inputs_assimp/IndexOutOfRange/IndexOutOfRange.gltf": "INDEX_RANGE",
    "bad_inputs_assimp/MissingBin/BoxTextured.gltf": "FILE",
    "bad_inputs_assimp/RecursiveNodes/RecursiveNodes.gltf": "NODE_CYCLE",
    "bad_inputs_assimp/SchemaFailures/sceneWrongType.gltf": "JSON_TYPE",
    "bad_inputs_assimp/TestNoRootNode/NoScene.gltf": "INDEX_RANGE",
    "bad_inputs_assimp/TestNoRootNode/SceneWithoutNodes.gltf": "NO_TRIANGLES",
    "bad_inputs_assimp/issue_3269/texcoord_crash.gltf": (10, 5),
    "bad_inputs_assimp/wrongTypes/badArray.gltf": "JSON_TYPE",
    "bad_inputs_assimp/wrongTypes/badExtension.gltf": "JSON_TYPE",
    "bad_inputs_assimp/wrongTypes/badNumber.gltf": "MISSING",
    "bad_inputs_assimp/wrongTypes/badObject.gltf": "JSON_TYPE",
    "bad_inputs_assimp/wrongTypes/badString.gltf": (12, 1),
    "bad_inputs_assimp/wrongTypes/badUint.gltf": "VALUE_RANGE",
    "blender_io_roundtrip/00_empty_scene/00_empty_scene.gltf": "NO_TRIANGLES",
    "blender_io_roundtrip/00_no_nodes/00_no_nodes.gltf": "NO_TRIANGLES",
    "blender_io_roundtrip/00_no_scene/00_no_scene.gltf": (12, 1),
    "blender_io_roundtrip/00_no_scenes/00_no_scenes.gltf": (12, 1),
    "blender_io_roundtrip/01_alpha_blend/01_alpha_blend.gltf": (14, 2),
    "blender_io_roundtrip/01_alpha_mask/01_alpha_mask.gltf": (2, 1),
    "blender_io_roundtrip/01_color_attribute/01_color_attribute.gltf": (1, 1),
    "blender_io_roundtrip/01_cs_rotate/01_cs_rotate.gltf": (12, 1),
    "blender_io_roundtrip/01_cs_scale/01_cs_scale.gltf": (12, 1),
    "blender_io_roundtrip/01_cs_translate/01_cs_translate.gltf": (12, 1),
    "blender_io_roundtrip/01_cube_no_material/01_cube_no_material.gltf": (12, 1),
    "blender_io_roundtrip/01_morphed_cube/01_morphed_cube.gltf": (12, 1),
    "blender_io_roundtrip/01_plane/01_plane.gltf": (2, 1),
    "blender_io_roundtrip/01_single_vs_double_sided/01_single_vs_double_sided.gltf": (1480, 2),
    "blender_io_roundtrip/01_triangle/01_triangle.gltf": (1, 1),
    "blender_io_roundtrip/01_unlit/01_unlit.gltf": (88, 2),
    "blender_io_roundtrip/01_vertex_count_16bit/01_vertex_count_16bit.gltf": (130378, 1),
    "blender_io_roundtrip/01_vertex_count_32bit/01_vertex_count_32bit.gltf": (130380, 1),
    "blender_io_roundtrip/02_node_hierarchy/02_node_hierarchy.gltf": (60, 2),
    "blender_io_roundtrip/02_shared_mesh/02_shared_mesh.gltf": (24, 2),
    "blender_io_roundtrip/03_skinned_cylinder/03_skinned_cylinder.gltf": (316, 1),
    "blender_io_roundtrip/04_common_materials/04_common_materials.gltf": (974, 3),
    "blender_io_roundtrip/04_lights/04_lights.gltf": (2, 1),
    "blender_io_roundtrip/05_metallic_sphere_light/05_metallic_sphere_light.gltf": (962, 2),
    "blender_io_roundtrip/08_combine_orm/08_combine_orm.gltf": (12, 1),
    "blender_io_roundtrip/09_texture_transform/09_texture_transform.gltf": (2, 1),
    "blender_io_roundtrip/10_custom_normals/10_custom_normals.gltf": (88, 2),
    "blender_io_roundtrip/11_factors_and_textures/11_factors_and_textures.gltf": (12, 1),
    "blender_io_roundtrip/12_orm_two_uvmaps/12_orm_two_uvmaps.gltf": (12, 1),
    "blender_io_roundtrip/13_occlusion_strength/13_occlusion_strength.gltf": (2, 1),
    "blender_io_roundtrip/13_texture_wrapping/13_texture_wrapping.gltf": (4, 2),
    "blender_io_roundtrip/14_emission_strength/14_emission_strength.gltf": (17280, 18),
    "blender_io_roundtrip/15_transmission/15_transmission.gltf": (3840, 4),
    "blender_io_roundtrip/18_variants/18_variants.gltf": (12, 3),
    "blender_io_roundtrip/22_factors/22_factors.gltf": (12, 1),
    "blender_io_roundtrip/22_vertex_color/22_vertex_color.gltf": (5, 3),
    "blender_io_roundtrip/23_multi_prim_vertex_attribute/23_multi_prim_vertex_attribute.gltf": (6, 2),
    "blender_io_roundtrip/24_gpu_instancing/24_gpu_instancing.gltf": (7656770, 1900),
    "compressed/gltfpack_fuzz.glb": (12, 1),
    "compressed/japanese_bridge_garden_meshopt_specgloss.glb": (21883, 13),
    "compressed/pirate_meshopt_quantized.glb": (5010, 1),
    "compressed/sponza_draco_webp.glb": (262266, 103),
    "easy_gltf/box_sparse.glb": (12, 1),
    "easy_gltf/cube_color.glb": (12, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_00.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_01.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_02.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_03.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_04.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_05.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_06.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_07.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_08.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_09.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_10.gltf": "NO_TRIANGLES",
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_11.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_12.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_13.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_14.gltf": (2, 1),
    "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_15.gltf": (2, 1),
    "khronos_samples/AlphaBlendModeTest/AlphaBlendModeTest.gltf": (61, 9),
    "khronos_samples/MorphCube/AnimatedMorphCube.gltf": (12, 1),
    "khronos_samples/NegativeScale_derived/NegativeScale_derived.gltf": (48, 4),
    "khronos_samples/RiggedSimple/RiggedSimple.gltf": (188, 1),
    "khronos_samples/SimpleMorph/SimpleMorph.gltf": (1, 1),
    "khronos_samples/SimpleSkin/SimpleSkin.gltf": (8, 1),
    "khronos_samples/SimpleSparseAccessor/SimpleSparseAccessor.gltf": (12, 1),
    "khronos_samples/TextureSettingsTest/TextureSettingsTest.gltf": (72, 10),
    "khronos_samples/TextureTransformTest/TextureTransformTest.gltf": (24, 12),
    "khronos_samples/UnlitTest/UnlitTest.gltf": (88, 2),
}
# What validate finds in parts of files that load: a warning, since they are not used.
UNUSED = {"bad_inputs_assimp/IncorrectVertexArrays/Cube.gltf": "BOUNDS"}


def test_no_file_is_forgotten():
    files = {path.relative_to(CONFORMANCE).as_posix() for path in CONFORMANCE.rglob("*.gl*")}
    assert files == set(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_every_file(name):
    if isinstance(EXPECTED[name], str):
        with pytest.raises(GsgiError) as refused:
            read_gltf(CONFORMANCE / name)
        assert refused.value.code == EXPECTED[name]
        assert name.rpartition("/")[2] in str(refused.value)
        return
    scene = read_gltf(CONFORMANCE / name)
    assert (sum(len(mesh.triangle) for mesh in scene.meshes), len(scene.meshes)) == EXPECTED[name]
    for mesh in scene.meshes:
        assert mesh.triangle.max() < len(mesh.position)
        assert len(mesh.normal) == len(mesh.uv) == len(mesh.position)
        np.testing.assert_allclose(np.linalg.norm(mesh.normal, axis=1), 1, atol=1e-5)
        channels = {slot.uv for slot in scene.materials[mesh.material].slots()}
        assert channels == set(range(mesh.uv.shape[1]))


@pytest.mark.parametrize("name", EXPECTED)
def test_validate_agrees_with_the_reader(name):
    codes = {"error": set(), "warning": set()}
    for problem in validate(CONFORMANCE / name):
        codes[problem.severity].add(problem.code)
    if isinstance(EXPECTED[name], str):
        assert EXPECTED[name] in codes["error"]
    else:
        assert codes["error"] == set()
    assert name not in UNUSED or UNUSED[name] in codes["warning"]


@pytest.mark.parametrize("name", [name for name, expected in EXPECTED.items() if not isinstance(expected, str)])
def test_positions_fill_the_bounds_that_accessors_state(name):
    document = open_document(CONFORMANCE / name, Limits())
    for mesh in document.root.get("meshes").items():
        for primitive in mesh.get("primitives").items():
            accessor = document.lookup("accessors", primitive.get("attributes").get("POSITION"))
            if "min" not in accessor or "incorrect" in name.lower():
                continue
            position = primitives.Attributes(document, primitive).floats("POSITION")
            low, high = (accessor.get(key).vector(3) for key in ("min", "max"))
            if accessor.get("normalized", False).data:
                continue
            tolerance = 2e-3 * np.abs(high - low).max()
            np.testing.assert_allclose(position.min(axis=0), low, atol=tolerance)
            np.testing.assert_allclose(position.max(axis=0), high, atol=tolerance)


# What the test models are made to show


def uv_at(mesh, point) -> np.ndarray:
    """Texture coordinates of a flat mesh at a point of its plane, by the affine map of its vertices."""
    affine = np.column_stack([mesh.position[:, :2], np.ones(len(mesh.position))])
    return [*point[:2], 1] @ np.linalg.lstsq(affine, mesh.uv[:, 0], rcond=None)[0]


def test_texture_transforms_point_to_the_green_markers():
    scene = read_gltf(CONFORMANCE / "khronos_samples/TextureTransformTest/TextureTransformTest.gltf")
    meshes = {scene.materials[mesh.material].name: mesh for mesh in scene.meshes}
    correct = [mesh for mesh in scene.meshes if scene.materials[mesh.material].name == "Correct"]
    for name, marker in zip(("Rotation", "Scale", "All"), correct, strict=True):
        u, v = uv_at(meshes[name], marker.position.mean(axis=0))
        assert abs(u - v) < 0.05, name  # the arrow lies on the texture's diagonal
        assert 0.7 < u < 0.85, name  # and its head here
    for name, offset in (("Offset U", (0.5, 0)), ("Offset V", (0, 0.5)), ("Offset UV", (0.5, 0.5))):
        np.testing.assert_allclose(meshes[name].uv[:, 0].min(axis=0), offset, atol=1e-6)


def test_texture_settings():
    scene = read_gltf(CONFORMANCE / "khronos_samples/TextureSettingsTest/TextureSettingsTest.gltf")
    assert {texture.wrap[0] for texture in scene.textures} == {"repeat", "mirror", "clamp"}
    assert {texture.wrap[1] for texture in scene.textures} == {"repeat", "mirror", "clamp"}
    assert {material.double_sided for material in scene.materials} == {True, False}


def test_negative_scale_keeps_boxes_turned_outwards():
    scene = read_gltf(CONFORMANCE / "khronos_samples/NegativeScale_derived/NegativeScale_derived.gltf")
    for mesh in scene.meshes:
        a, b, c = (mesh.position[corner] for corner in mesh.triangle.T)
        outwards = a + b + c - 3 * mesh.position.mean(axis=0)
        assert ((np.cross(b - a, c - a) * outwards).sum(axis=1) > 0).all()
        assert ((mesh.normal[mesh.triangle[:, 0]] * outwards).sum(axis=1) > 0).all()


def test_alpha_modes():
    scene = read_gltf(CONFORMANCE / "khronos_samples/AlphaBlendModeTest/AlphaBlendModeTest.gltf")
    cutoffs = {material.name: material.alpha_cutoff for material in scene.used_materials()}
    assert cutoffs["MatOpaque"] is None
    assert (cutoffs["MatCutoff25"], cutoffs["MatCutoff75"], cutoffs["MatCutoffDefault"]) == (0.25, 0.75, 0.5)
    assert cutoffs["MatBlend"] == pytest.approx(1 / 255), "below it nothing is drawn, and all light passes"
    blended = scene.materials[scene.blended[0].material]
    assert (blended.name, blended.alpha_cutoff, blended.stand_in) == ("MatBlend", None, False)
    assert [material.name for material in scene.materials if material.stand_in] == ["MatBlend"]


def test_primitive_modes_depict_one_square():
    folder = "glTF-Asset-Generator/Mesh_PrimitiveMode/"
    for name in [name for name in EXPECTED if name.startswith(folder) and not isinstance(EXPECTED[name], str)]:
        (mesh,) = read_gltf(CONFORMANCE / name).meshes
        a, b, c = (mesh.position[corner] for corner in mesh.triangle.T)
        np.testing.assert_allclose(np.cross(b - a, c - a).sum(axis=0), [0, 0, 2], atol=1e-6)
        np.testing.assert_array_equal(np.unique(mesh.position[:, :2]), [-0.5, 0.5])


def test_compressed_sponza_equals_sponza():
    plain = read_gltf(SHARED / "sponza_crytek/sponza.gltf")
    packed = read_gltf(CONFORMANCE / "compressed/sponza_draco_webp.glb")
    np.testing.assert_allclose(packed.bounds(), plain.bounds(), atol=1e-2)
    assert len(packed.textures) == len(plain.textures)
    for one, other in zip(plain.meshes, packed.meshes, strict=True):
        assert len(one.triangle) == len(other.triangle)
        areas = [doubled_area(mesh) for mesh in (one, other)]
        assert areas[1] == pytest.approx(areas[0], rel=0.02)


def doubled_area(mesh) -> float:
    a, b, c = (mesh.position[corner].astype(float) for corner in mesh.triangle.T)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
