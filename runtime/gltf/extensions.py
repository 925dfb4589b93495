"""Check the version and the extensions of a glTF file against what the reader supports."""

import json

from . import draco, instancing, lights, materials, meshopt, textures, transparency
from .document import Document
from .json_value import Json
from .problems import Code

READ = {
    lights.NAME,
    materials.EMISSIVE_STRENGTH,
    materials.UNLIT,
    materials.SPECULAR_GLOSSINESS,
    transparency.TRANSMISSION,
    textures.TRANSFORM,
    textures.WEBP,
    instancing.NAME,
    draco.NAME,
    *meshopt.NAMES,
    "KHR_mesh_quantization",
}
# They change only the specular part of a material.
LAMBERTIAN = {
    f"KHR_materials_{name}"
    for name in ("ior", "specular", "clearcoat", "sheen", "volume", "iridescence", "anisotropy", "dispersion")
}
VARIANTS = "KHR_materials_variants"  # alternative materials for the same surfaces
IGNORED = {
    **dict.fromkeys(LAMBERTIAN | {"KHR_materials_diffuse_transmission"}, "surfaces are Lambertian"),
    VARIANTS: "the default materials are used",
    textures.BASISU: "plain images are used",
}
MAY_BE_REQUIRED = READ | LAMBERTIAN | {VARIANTS}


def check_header(document: Document) -> None:
    """Refuse unsupported versions and required extensions; warn about other unsupported extensions."""
    check_version(document.root.get("asset"))
    for name in document.root.get("extensionsRequired", []).items():
        check_required(name)
    for name in document.root.get("extensionsUsed", []).items():
        text = name.string()
        if text not in READ:
            reason = f": {IGNORED[text]}" if text in IGNORED else ""
            document.warn(name, Code.EXTENSION_IGNORED, f"extension {json.dumps(text)} is ignored{reason}")


def check_version(asset: Json) -> None:
    """Raise SceneError unless the file is glTF 2, and UnsupportedError if it needs a later 2.x."""
    version = asset.get("version")
    if version.string().split(".")[0] != "2":
        raise version.refuse('version "2.0"', code=Code.VERSION)
    if asset.get("minVersion", "2.0").string() != "2.0":
        raise asset.get("minVersion").unsupported("only glTF 2.0 is supported", Code.VERSION)


def check_required(name: Json) -> None:
    """Raise UnsupportedError if a required extension is not supported."""
    if name.string() not in MAY_BE_REQUIRED:
        text = f"extension {json.dumps(name.string())} is required and not supported"
        raise name.unsupported(text, Code.UNSUPPORTED_EXTENSION)
