"""Warn of a valid scene that looks other than its author may expect: dark metals, a size in other units than metres."""

import numpy as np

from gsgi.runtime.scene import Material, Scene

from .document import Document
from .problems import Code
from .world_space import face_vectors

METAL = 0.5  # a metallic value above this takes more than half of the diffuse light
METAL_SHARE = 0.05  # of all surface; below it, metals are fittings that nobody misses
LARGEST, SMALLEST = 2000.0, 0.05  # m; the diagonals of a town quarter and of a matchbox


def warn_of_metal(document: Document, scene: Scene) -> None:
    """Warn if much of the surface of a scene is metallic, with its area and the material that has most of it."""
    shares = np.array([_metal_share(material, scene) for material in scene.materials])
    if not shares.any():
        return
    areas = np.zeros(len(shares))
    for mesh in scene.meshes:
        areas[mesh.material] += np.linalg.norm(face_vectors(mesh.position, mesh.triangle), axis=1).sum() / 2
    metal = areas * shares
    if metal.sum() > METAL_SHARE * areas.sum():
        name = scene.materials[metal.argmax()].name
        most = f', most of it "{name}"' if name and name.isprintable() else ""
        text = f"{metal.sum():.3g} m^2, {metal.sum() / areas.sum():.0%} of all surface, is metal{most}: it has no"
        document.warn(document.root.get("materials", []), Code.METAL, f"{text} diffuse light and stays dark")


def warn_of_size(document: Document, scene: Scene) -> None:
    """Warn if a scene is so large or so small that its unit is hardly the metre."""
    extent = scene.diagonal()
    if SMALLEST <= extent <= LARGEST:
        return
    size = f"{extent / 1000:.3g} km" if extent > LARGEST else f"{extent * 1000:.3g} mm"
    text = f"the scene is {size} across: glTF counts in metres; if it was made in another unit, export it with a scale"
    document.warn(document.root, Code.SIZE, text)


def _metal_share(material: Material, scene: Scene) -> float:
    """The share of a material's surface that is metallic, judged by its whole texture; 0 if it is black anyway."""
    if not any(material.base_color[:3]):
        return 0.0
    if material.metallic_texture is None:
        return float(material.metallic > METAL)
    texels = scene.textures[material.metallic_texture.texture].pixels[..., 2]
    return float((texels > METAL * 255 / material.metallic).mean())
