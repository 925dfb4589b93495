"""Shader permutations: the defines of each pass, and the property of a scene, file or host that sets each of them.

One table covers all passes. A pass is not created if the scene lacks its effect, so there is no define for that case.
The file's effects record sets no define: it says what the stored light holds, not how it is read.
"""

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from gsgi.runtime.gaussians import SurfaceBlend
from gsgi.runtime.scene import Light, Material, TextureSlot

from .host_textures import Encoding

_WIDEST_FACE = 0.5  # cosine; a cone wider than 60 degrees to a side would waste texels of a single face: it gets a cube


class Triangles(NamedTuple):
    """Triangles that are drawn at once: all of one material, with or without vertex colours.

    `bent`: whether any material that is drawn, this one or another, has a normal map. `peeled`: whether they are part
    of a layer of partly transparent surfaces. `instanced`: whether they stand in several places.
    """

    material: Material
    colored: bool
    bent: bool = False
    peeled: bool = False
    instanced: bool = False


class Reading(NamedTuple):
    """How the `surface` operator reads light.

    `boxed`: whether only surfaces in a box are lit; `relief`: whether light follows normal maps; `sectors`: whether
    several sectors have light.
    """

    splat_scale: int
    encoding: Encoding
    boxed: bool
    relief: bool = False
    sectors: bool = False


class Primitive(NamedTuple):
    """A primitive of a pyrender scene.

    `slots`: names of the textures that it shows. `lights`, `shadows` and `indirect` say what lights it if it is `lit`.
    `lookup`: it reads B by itself from a bake with these counts (see `lookup_defines`). `relief`: whether B that others
    read for it follows normal maps.
    """

    slots: Collection[str]
    normals: bool
    colored: bool
    lit: bool = False
    lights: int = 0
    shadows: bool = False
    indirect: bool = False
    lookup: tuple[int, int, int] | None = None
    relief: bool = False


def sampled(material: Material) -> dict[str, TextureSlot]:
    """Textures that a material reads, by the names of their slots in the shaders."""
    slots = {"base": material.base_color_texture}
    if not material.unlit:
        slots["metallic"] = material.metallic_texture
        slots["normal"] = material.normal_texture
        slots["emission"] = material.emission_texture
    return {name: slot for name, slot in slots.items() if slot is not None}


def face_count(light: Light) -> int:
    """Number of faces of the light's shadow map: 1 or 6."""
    wide = light.kind == "point" or (light.kind == "spot" and light.cos_outer < _WIDEST_FACE)
    return 6 if wide else 1


def _masked(triangles: Triangles) -> bool:
    return triangles.material.alpha_cutoff is not None


def _shadow_masked(triangles: Triangles) -> bool:
    return triangles.material.shadow_cutoff is not None


def lookup_defines(fine: int, coarse: int, relief: int) -> dict[str, int]:
    """Defines of surface/gsgi_indirect.glsl for levels with that many SH coefficients, and so many texels of relief."""
    return {"FINE_SH_COUNT": fine, "COARSE_SH_COUNT": coarse, "RELIEF_COUNT": relief}


def _lookup_define(name: str, counts: tuple[int, int, int] | None) -> int:
    return lookup_defines(*counts)[name] if counts else 0


# Defines that the host's Encoding sets.
_HOST = {name: lambda reading, name=name: reading.encoding.defines()[name] for name in Encoding().defines()}

# Defines of the passes that fill the G-buffer.
_SURFACE = {
    "BASE_TEXTURE": lambda t: "base" in sampled(t.material),
    "METALLIC_TEXTURE": lambda t: "metallic" in sampled(t.material),
    "NORMAL_TEXTURE": lambda t: "normal" in sampled(t.material),
    "EMISSION_TEXTURE": lambda t: "emission" in sampled(t.material),
    "VERTEX_COLOR": lambda t: t.colored,
    "ALPHA_MASK": _masked,
    "UNLIT": lambda t: t.material.unlit,
    "INTERPOLATED": lambda t: t.bent,
    "PEELED": lambda t: t.peeled,
    "INSTANCED": lambda t: t.instanced,
}

# Defines of each pass. A function returns the value for what the pass draws or reads; a comment names its type.
PASSES: dict[str, dict[str, Callable[[Any], int]]] = {
    "frame/gbuffer": _SURFACE,  # Triangles
    "frame/background": {"DIMMABLE": lambda dimmable: dimmable},  # bool; created if there is an environment
    "frame/shadow": {  # Triangles
        "BASE_TEXTURE": lambda t: _shadow_masked(t) and "base" in sampled(t.material),
        "VERTEX_COLOR": lambda t: _shadow_masked(t) and t.colored,
        "ALPHA_MASK": _shadow_masked,
        "INSTANCED": lambda t: t.instanced,
    },
    "frame/primary": {  # Light
        "SPOT": lambda light: light.kind == "spot",
        "DIRECTIONAL": lambda light: light.kind == "directional",
        "FACES": face_count,
    },
    "over/splat": {"SH_DEGREE": lambda gaussians: gaussians.sh_degree},  # Gaussians
    "surface/points": {  # Reading
        "SPLAT_SCALE": lambda reading: reading.splat_scale,
        "BOX": lambda reading: reading.boxed,
        "RELIEF": lambda reading: reading.relief,
        "SECTORS": lambda reading: reading.sectors,
        **_HOST,
    },
    "surface/read": {  # (Reading, arguments of `lookup_defines`)
        "SPLAT_SCALE": lambda part: part[0].splat_scale,
        "RELIEF": lambda part: part[0].relief,
        "SECTORS": lambda part: part[0].sectors,
        **{name: lambda part, name=name: lookup_defines(*part[1])[name] for name in lookup_defines(0, 0, 0)},
    },
    "surface/smooth": {"SPLAT_SCALE": lambda reading: reading.splat_scale},  # Reading; created if sums are upsampled
    "surface/resolve": {  # Reading; created if sums are upsampled
        "SPLAT_SCALE": lambda reading: reading.splat_scale,
        **_HOST,
    },
    "surface/add_light": {"ALBEDO_SRGB": lambda encoding: encoding.albedo_defines()["ALBEDO_SRGB"]},  # Encoding
    "frame/composite": {},
    "frame/blend": {  # (int, int, int): as of panda3d/light; None: without B
        "LOOKUP": lambda counts: counts is not None,
        **{name: lambda counts, name=name: _lookup_define(name, counts) for name in lookup_defines(0, 0, 0)},
    },
    "frame/tint": {},  # created if a partly transparent surface tints what is behind it
    "frame/display": {"SURFACES_ONLY": lambda masked: masked},  # bool
    "viewer/ellipsoids": {  # Bake
        "SH_DEGREE": lambda bake: bake.gaussians.sh_degree,
        "NORMAL_COLOR": lambda bake: isinstance(bake.blend, SurfaceBlend),
    },
    "viewer/overlay": {},
    "panda3d/light": {  # (int, int, int): arguments of `lookup_defines`
        name: lambda counts, name=name: lookup_defines(*counts)[name] for name in lookup_defines(0, 0, 0)
    },
    "panda3d/add": {},
    "tradeoff/ambient": {},
    "tradeoff/light_volume": {},
    "tradeoff/lightmap": _SURFACE,  # Triangles
    "tradeoff/probes": {"VISIBILITY": lambda tested: tested},  # bool: whether probes are tested for visibility
    "tradeoff/vertex_light": _SURFACE,  # Triangles
    "tradeoff/voxels": {},
    "pyrender/forward": {  # Primitive
        "NORMAL": lambda p: p.lit and p.normals,
        "VERTEX_COLOR": lambda p: p.colored,
        "TEXTURES": lambda p: len(p.slots) > 0 if p.lit else "base" in p.slots,
        "NORMAL_TEXTURE": lambda p: p.lit and "normal" in p.slots,
        "LIT": lambda p: p.lit,
        "LIGHTS": lambda p: p.lights,
        "SHADOWS": lambda p: p.shadows,
        "INDIRECT": lambda p: p.indirect,
        "LOOKUP": lambda p: p.lookup is not None,
        **{name: lambda p, name=name: _lookup_define(name, p.lookup) for name in lookup_defines(0, 0, 0)},
    },
    "pyrender/silhouette": {},
    "pyrender/visible": {  # Primitive
        "NORMAL": lambda p: p.normals,
        "NORMAL_TEXTURE": lambda p: p.relief and "normal" in p.slots,
        "RELIEF": lambda p: p.relief,
    },
}


def defines(name: str, subject=None) -> dict[str, int]:
    """Defines of the pass `name` for its `subject`, whose type the table names."""
    return {define: int(rule(subject)) for define, rule in PASSES[name].items()}
