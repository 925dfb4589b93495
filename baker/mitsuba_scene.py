"""A `Scene` as a Mitsuba scene: one mesh per material, Lambertian surfaces, emissive surfaces as area lights."""

import sys

import numpy as np

from gsgi.runtime.scene import Material, Mesh, Scene

from . import llvm

# Threshold of the shifted alpha that `_opacity` stores; the integrator lets rays through below it.
ALPHA_HOLE = 0.5

# The integrator tells a visible back from a culled one by its reflectance being above 0, so none is black.
ALBEDO_MIN = 1e-6

# Of the scene's diagonal; the back of a double-sided emitter lies this far behind its front.
EMITTER_GAP = 1e-5


def load_mitsuba():
    """The mitsuba module with our variant set. The first call takes about a second."""
    if "mitsuba" not in sys.modules:
        llvm.select()
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("llvm_ad_rgb")
    return mi


def build(scene: Scene):
    """The `mitsuba.Scene` of `scene`, without its punctual lights (the integrator samples those itself).

    A surface that is single-sided keeps a one-sided BSDF, which reflects nothing from behind.
    """
    mi = load_mitsuba()
    gap = EMITTER_GAP * scene.diagonal()
    parts = {"type": "scene"}
    for index, material in enumerate(scene.materials):
        meshes = [mesh for mesh in scene.meshes if mesh.material == index]
        if not meshes:
            continue
        merged = _merge(meshes)
        parts[f"material{index}"] = _mesh(mi, merged, material, scene, material.double_sided)
        if material.double_sided and emits(material, scene):
            parts[f"material{index}_back"] = _mesh(mi, _flip(merged, gap), material, scene, double_sided=False)
    return mi.load_dict(parts)


def emits(material: Material, scene: Scene) -> bool:
    """Whether a surface of this material gives off light somewhere."""
    factor = np.array(material.emission) > 0
    if material.emission_texture is not None and factor.any():
        factor &= scene.textures[material.emission_texture].pixels[..., :3].any(axis=(0, 1))
    return bool(factor.any())


def samples_light(material: Material, scene: Scene) -> bool:
    """Whether light sampling may pick points of an emitter: Mitsuba picks those of a textured one in UV space, which
    misses light where UVs overlap or tile, and knows no holes. Such emitters are found by bounces alone."""
    return material.emission_texture is None and material.alpha_cutoff is None and emits(material, scene)


def used_materials(scene: Scene) -> list[Material]:
    """The materials that some triangle has."""
    return [scene.materials[index] for index in sorted({mesh.material for mesh in scene.meshes})]


def has_emitters(scene: Scene) -> bool:
    """Whether any triangle emits light."""
    return any(emits(material, scene) for material in used_materials(scene))


def has_masks(scene: Scene) -> bool:
    """Whether any triangle has alpha-tested holes."""
    return any(material.alpha_cutoff is not None for material in used_materials(scene))


def _merge(meshes: list[Mesh]) -> Mesh:
    offsets = np.cumsum([0, *(len(mesh.position) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.position for mesh in meshes]),
        np.concatenate([mesh.normal for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate([m.triangle + np.uint32(o) for m, o in zip(meshes, offsets, strict=True)]),
        meshes[0].material,
    )


def _flip(mesh: Mesh, gap: float) -> Mesh:
    """The same triangles seen from behind, moved behind themselves by `gap` (m)."""
    position = mesh.position - np.float32(gap) * mesh.normal
    return Mesh(position, -mesh.normal, mesh.uv, np.ascontiguousarray(mesh.triangle[:, ::-1]), mesh.material)


def _mesh(mi, mesh: Mesh, material: Material, scene: Scene, double_sided: bool):
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_bsdf(mi, material, scene, double_sided))
    if emits(material, scene):
        radiance = _texture(mi, _emission(material, scene), scene, material.emission_texture)
        emitter = {"type": "area", "radiance": radiance, "sampling_weight": _sampling_weight(mesh, material, scene)}
        properties["emitter"] = mi.load_dict(emitter)
    shape = mi.Mesh(
        f"material{mesh.material}",
        vertex_count=len(mesh.position),
        face_count=len(mesh.triangle),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = mesh.position.ravel()
    parameters["vertex_normals"] = mesh.normal.ravel()
    parameters["vertex_texcoords"] = mesh.uv.ravel()
    parameters["faces"] = mesh.triangle.ravel()
    parameters.update()
    return shape


def _bsdf(mi, material: Material, scene: Scene, double_sided: bool) -> dict:
    albedo = _texture(mi, _albedo(material, scene), scene, material.base_color_texture)
    bsdf = {"type": "diffuse", "reflectance": albedo}
    if double_sided:
        bsdf = {"type": "twosided", "bsdf": bsdf}
    if material.alpha_cutoff is not None:
        opacity = _texture(mi, _opacity(material, scene), scene, material.base_color_texture)
        bsdf = {"type": "mask", "opacity": opacity, "bsdf": bsdf}
    return bsdf


def _texture(mi, values: np.ndarray, scene: Scene, texture: int | None) -> dict | float:
    """Mitsuba texture of linear values (H, W, C) float32; (C,) for a constant. v = 0 is the top row, as in glTF."""
    if values.ndim == 1:
        return {"type": "rgb", "value": values.tolist()} if len(values) == 3 else float(values[0])
    wrap = scene.textures[texture].wrap
    # Mitsuba has one mode for both axes.
    return {"type": "bitmap", "bitmap": mi.Bitmap(values), "raw": True, "wrap_mode": wrap[0]}


def _texels(texture: int | None, scene: Scene) -> np.ndarray | None:
    return None if texture is None else scene.textures[texture].pixels.astype(np.float32) / np.float32(255)


def _linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB (IEC 61966-2-1) to linear."""
    low, high = srgb / 12.92, ((srgb + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(srgb <= 0.04045, low, high).astype(np.float32)


def _albedo(material: Material, scene: Scene) -> np.ndarray:
    factor = np.array(material.base_color[:3], np.float32) * np.float32(1 - material.metallic)
    texels = _texels(material.base_color_texture, scene)
    return np.maximum(factor if texels is None else _linear(texels[..., :3]) * factor, np.float32(ALBEDO_MIN))


def _emission(material: Material, scene: Scene) -> np.ndarray:
    factor = np.array(material.emission, np.float32)
    texels = _texels(material.emission_texture, scene)
    return factor if texels is None else _linear(texels[..., :3]) * factor


def _opacity(material: Material, scene: Scene) -> np.ndarray:
    """Alpha minus cut-off plus ALPHA_HOLE: filtering and thresholding at ALPHA_HOLE then equal glTF's alpha test."""
    texels = _texels(material.base_color_texture, scene)
    alpha = np.float32(material.base_color[3])
    shift = np.float32(ALPHA_HOLE - material.alpha_cutoff)
    return np.atleast_1d(alpha + shift) if texels is None else texels[..., 3:] * alpha + shift


def _sampling_weight(mesh: Mesh, material: Material, scene: Scene) -> float:
    """How often light sampling picks this mesh: area (m^2) times mean radiance, or never."""
    if not any(samples_light(other, scene) for other in used_materials(scene)):
        return 1.0  # Mitsuba refuses zeros alone; the integrator does not sample lights then
    if not samples_light(material, scene):
        return 0.0
    a, b, c = (mesh.position[mesh.triangle[:, i]].astype(np.float64) for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return float(area * np.mean(material.emission))
