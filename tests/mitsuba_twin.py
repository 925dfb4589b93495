"""A `Scene` for Mitsuba's own integrators, BSDFs, textures and emitters, as an independent check.

It supports one uv channel and one wrap mode for both axes, but no alpha masks, normal maps, vertex colours or black
metals.
"""

import numpy as np

from gsgi.baker.trace.mitsuba_scene import load_mitsuba
from gsgi.runtime.scene import Material, Mesh, Scene, TextureSlot


def build(scene: Scene):
    """The `mitsuba.Scene` of `scene` with its emissive surfaces, point and directional lights."""
    mi = load_mitsuba()
    parts = {"type": "scene"}
    for index, material in enumerate(scene.materials):
        merged = _merge([mesh for mesh in scene.meshes if mesh.material == index])
        parts[f"material{index}"] = _mesh(mi, merged, material, scene)
    for index, light in enumerate(scene.lights):
        color = {"type": "rgb", "value": light.color.tolist()}
        if light.kind == "directional":
            parts[f"light{index}"] = {"type": light.kind, "direction": light.direction.tolist(), "irradiance": color}
        else:
            parts[f"light{index}"] = {"type": light.kind, "position": light.position.tolist(), "intensity": color}
    return mi.load_dict(parts)


def radiance(scene: Scene, position: np.ndarray, eye: np.ndarray, samples: int, depth: int = 40) -> np.ndarray:
    """Radiance (N, 3) from points (N, 3) towards `eye` (3,) by Mitsuba's `path`, the mean of `samples` paths each.

    It is the full light, or with `depth` 2 the emission at the point and the light straight from light sources.
    """
    import drjit as dr

    mi = load_mitsuba()
    direction = (position - eye).repeat(samples, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ray = mi.RayDifferential3f(mi.Point3f(*map(float, eye)), mi.Vector3f(direction.T.astype(np.float32)))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, len(direction))
    light, _, _ = mi.load_dict({"type": "path", "max_depth": depth}).sample(build(scene), sampler, ray)
    return np.stack([np.array(dr.block_sum(c, samples)) / samples for c in light], axis=-1)


def _merge(meshes: list[Mesh]) -> Mesh:
    offsets = np.cumsum([0, *(len(mesh.position) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.position for mesh in meshes]),
        np.concatenate([mesh.normal for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate([m.triangle + np.uint32(o) for m, o in zip(meshes, offsets, strict=True)]),
        meshes[0].material,
    )


def _mesh(mi, mesh: Mesh, material: Material, scene: Scene):
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_bsdf(mi, material, scene))
    if scene.emits(material):
        emission = _texture(mi, _emission(material, scene), scene, material.emission_texture)
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": emission})
    shape = mi.Mesh(
        f"material{mesh.material}",
        vertex_count=len(mesh.position),
        face_count=len(mesh.triangle),
        has_vertex_normals=True,
        has_vertex_texcoords=mesh.uv.shape[1] > 0,
        props=properties,
    )
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = mesh.position.ravel()
    parameters["vertex_normals"] = mesh.normal.ravel()
    if mesh.uv.shape[1]:
        parameters["vertex_texcoords"] = mesh.uv[:, 0].ravel()
    parameters["faces"] = mesh.triangle.ravel()
    parameters.update()
    return shape


def _bsdf(mi, material: Material, scene: Scene) -> dict:
    albedo = _texture(mi, _albedo(material, scene), scene, material.base_color_texture)
    bsdf = {"type": "diffuse", "reflectance": albedo}
    if material.double_sided:
        bsdf = {"type": "twosided", "bsdf": bsdf}
    return bsdf if material.filter is None else _filter(material, bsdf)


def _filter(material: Material, bsdf: dict) -> dict:
    """What lets light through: a mask of constant opacity, or a pane without refraction, untextured."""
    if material.filter.blends:
        return {"type": "mask", "opacity": material.base_color[3], "bsdf": bsdf}
    tint = {"type": "rgb", "value": list(material.base_color[:3])}
    pane = {"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0, "specular_transmittance": tint}
    return {"type": "blendbsdf", "weight": material.filter.transmission, "first": bsdf, "second": pane}


def _texture(mi, values: np.ndarray, scene: Scene, slot: TextureSlot | None) -> dict | float:
    """Mitsuba texture of linear values (H, W, C) float32; (C,) for a constant. v = 0 is the top row, as in glTF."""
    if values.ndim == 1:
        return {"type": "rgb", "value": values.tolist()} if len(values) == 3 else float(values[0])
    wrap = scene.textures[slot.texture].wrap
    return {"type": "bitmap", "bitmap": mi.Bitmap(values), "raw": True, "wrap_mode": wrap[0]}


def _texels(slot: TextureSlot | None, scene: Scene) -> np.ndarray | None:
    return None if slot is None else scene.textures[slot.texture].pixels.astype(np.float32) / np.float32(255)


def _linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB (IEC 61966-2-1) to linear."""
    low, high = srgb / 12.92, ((srgb + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(srgb <= 0.04045, low, high).astype(np.float32)


def _albedo(material: Material, scene: Scene) -> np.ndarray:
    factor = np.array(material.base_color[:3], np.float32)
    texels = _texels(material.base_color_texture, scene)
    return factor if texels is None else _linear(texels[..., :3]) * factor


def _emission(material: Material, scene: Scene) -> np.ndarray:
    factor = np.array(material.emission, np.float32)
    texels = _texels(material.emission_texture, scene)
    return factor if texels is None else _linear(texels[..., :3]) * factor
