"""A scene as arrays: triangles in world space, materials, punctual lights, cameras."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .camera import Camera

if TYPE_CHECKING:
    from .instance import Instance

BLENDED_MOST = 4  # most blended surfaces that a pixel shows in front of the solid one: the next is seen through four
CUTOFF = 0.5  # opacity below which a partly transparent surface is a hole to what cannot see through it in part
MAX_LIGHT = 1e15  # cd, lx or radiance; the product of two such values fits in float32


@dataclass(frozen=True)
class Texture:
    """`pixels` (H, W, 4) uint8 as stored in the file, with row 0 at the top; the material slot defines their meaning.

    `wrap` is "repeat", "mirror" or "clamp" per axis (u, v). v = 0 is at the top. Filtering is bilinear without mip
    levels, or nearest-texel if `nearest` is set.
    """

    pixels: np.ndarray
    wrap: tuple[str, str] = ("repeat", "repeat")
    nearest: bool = False


# The fields of a material that refer to a texture.
TEXTURE_SLOTS = ("base_color_texture", "metallic_texture", "normal_texture", "emission_texture")


@dataclass(frozen=True)
class TextureSlot:
    """How a material uses a texture: index into `Scene.textures` and channel of `Mesh.uv`."""

    texture: int
    uv: int = 0


@dataclass(frozen=True)
class Filter:
    """How a partly transparent surface lets light straight through, seen from either side.

    It covers the share A: alpha (factor * texture * vertex colour) if it `blends`, else 1. What it covers transmits the
    share `transmission`, tinted by the base colour, and reflects and emits the rest as an opaque surface does. What it
    leaves open is clear, or tinted by the base colour too if `stained`. Where alpha is below `clear` it casts no
    shadow: punctual light that passes there is direct light, which the frame computes.
    """

    blends: bool = False
    transmission: float = 0.0
    stained: bool = False
    clear: float = 0.0


@dataclass(frozen=True)
class Material:
    """A Lambertian surface. Its albedo is the base colour, or base colour * (1 - metallic) where metals are black.

    base colour = factor * texture (sRGB) * vertex colour; metallic = factor * blue channel of the texture (linear). If
    `alpha_cutoff` is None, the surface is opaque; otherwise points whose alpha (factor * texture * vertex colour) is
    below it are holes. The back of a single-sided surface (not `double_sided`) is not drawn, reflects and emits
    nothing, but still blocks light. The normal texture (linear, tangent space, xy scaled by `normal_scale`) shapes
    the light that is seen; light that goes on from the surface is that of the interpolated normal. An `unlit` surface
    shows its base colour as radiance, has albedo 0 and emits no light into the scene. A `stand_in` is what light meets
    of a partly transparent surface: it is not drawn itself, since frames show `Scene.blended`. Its `filter` lets light
    through; shadow maps take it for opaque where its alpha is not below `shadow_cutoff`, and punctual light that it
    lets through there is part of B. What is seen through a blended surface has the tint (1 - tint) + tint * base
    colour.
    """

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)  # linear
    base_color_texture: TextureSlot | None = None
    metallic: float = 0.0
    metallic_texture: TextureSlot | None = None
    normal_texture: TextureSlot | None = None
    normal_scale: float = 1.0
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)  # radiance: factor * strength
    emission_texture: TextureSlot | None = None  # sRGB
    alpha_cutoff: float | None = None
    double_sided: bool = False
    unlit: bool = False
    stand_in: bool = False
    filter: Filter | None = None
    tint: float = 0.0

    @property
    def shadow_cutoff(self) -> float | None:
        """The alpha below which a shadow map has a hole. None: it has none. Infinite: the surface casts no shadow."""
        clear = self.filter.clear if self.filter else 0.0
        return max(self.alpha_cutoff or 0.0, clear) if clear else self.alpha_cutoff

    def slots(self) -> tuple[TextureSlot, ...]:
        """The texture slots that the material uses."""
        slots = (getattr(self, name) for name in TEXTURE_SLOTS)
        return tuple(slot for slot in slots if slot is not None)


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material in world space, counter-clockwise seen from the front.

    position (V, 3) float32, m; normal (V, 3) float32, unit; triangle (F, 3) uint32. uv (V, C, 2) float32 has one
    channel per pair of texture coordinate set and transform that the material uses, with the transform applied; C = 0
    without textures. color (V, 4) float32 is linear; None means white. tangent (V, 4) float32 has a unit xyz
    perpendicular to the normal; bitangent = w * cross(normal, xyz), w = 1 or -1. It is None if the material has no
    normal texture. `name` is that of the node, or else of the entry of the file's meshes.
    """

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    triangle: np.ndarray
    material: int
    color: np.ndarray | None = None
    tangent: np.ndarray | None = None
    name: str = ""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Minimum and maximum corner of the triangles, two (3,) float64, m. Unused vertices are ignored."""
        used = np.zeros(len(self.position), bool)
        used[self.triangle] = True
        corners = self.position[used].astype(np.float64)
        return corners.min(axis=0), corners.max(axis=0)

    def areas(self) -> np.ndarray:
        """Area (F,) float64 of each triangle, m^2."""
        a, b, c = (self.position[self.triangle[:, i]] for i in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1).astype(np.float64) / 2


@dataclass(frozen=True)
class Light:
    """A punctual light of KHR_lights_punctual.

    `color` (3,) is colour * intensity in linear Rec.709: radiant intensity (cd) for point and spot lights, irradiance
    (lx) for directional lights.
    """

    kind: str  # "point", "spot" or "directional"
    color: np.ndarray
    position: np.ndarray  # (3,) world space, m; unused by "directional"
    direction: np.ndarray  # (3,) unit, in which light travels; unused by "point"
    range: float = np.inf  # m; no light reaches this distance or beyond
    cos_inner: float = 1.0
    cos_outer: float = 0.0
    name: str = ""  # of the node, or else of the entry
    entry: str = ""  # name of the entry of the file's lights that the node places


@dataclass(frozen=True)
class Environment:
    """Light from infinitely far away: `radiance` (H, W, 3) float32, linear Rec.709, equirectangular.

    Row 0 is up (+Y). The middle column points to -Z and the columns to its right towards +X. The image is then rotated
    by `rotation` (rad) about +Y, counter-clockwise seen from above. Radiance is constant within a texel; (1, 1, 3) is
    a uniform environment.
    """

    radiance: np.ndarray
    rotation: float = 0.0

    @property
    def even(self) -> bool:
        """Whether the radiance is the same in all directions."""
        return bool((self.radiance == self.radiance[0, 0]).all())


@dataclass(frozen=True)
class Scene:
    """Everything that the baker and the renderer need from a glTF file.

    Where a file has many copies of large meshes, `meshes` and `blended` have an `Instance` for each.
    `blended` are partly transparent surfaces, whose opacity is alpha (factor * texture * vertex colour): a frame blends
    them over `meshes`, and the light knows nothing of them. `metals` is "rough" (they reflect diffusely, as rough ones
    would on average) or "black" (they reflect nothing).
    `warnings` are one line each. `transparent` repeats the text (without file and pointer) of the warnings about partly
    transparent materials. `files` lists the files that the scene was read from: the glTF file first, then its buffers
    and images, then files that define light. `groups` are the lights that are to be baked apart: patterns of their
    names, by the name of the group (see `light_groups`).
    """

    meshes: "tuple[Mesh | Instance, ...]"
    materials: tuple[Material, ...]
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    environment: Environment | None = None
    cameras: dict[str, Camera] = field(default_factory=dict)
    metals: str = "rough"
    warnings: tuple[str, ...] = ()
    transparent: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    blended: "tuple[Mesh | Instance, ...]" = ()
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def as_traced(self) -> "Scene":
        """The scene as camera rays of the path tracer meet it: nothing is blended.

        Stand-ins are shown, except those that let light through: in their place stand the surfaces that frames blend,
        solid where their opacity is at least CUTOFF and with holes elsewhere.
        """
        materials = [replace(material, stand_in=material.filter is not None) for material in self.materials]
        if not any(material.filter for material in self.materials):
            return replace(self, materials=tuple(materials), blended=())
        for index in {mesh.material for mesh in self.blended}:
            materials[index] = replace(materials[index], alpha_cutoff=max(CUTOFF, materials[index].alpha_cutoff or 0.0))
        return replace(self, materials=tuple(materials), meshes=self.meshes + self.blended, blended=())

    def used_materials(self) -> list[Material]:
        """The materials that at least one of `meshes` uses."""
        return [self.materials[index] for index in sorted({mesh.material for mesh in self.meshes})]

    @property
    def bumpy(self) -> bool:
        """Whether a used material has a normal map."""
        return any(material.normal_texture for material in self.used_materials())

    def emits(self, material: Material) -> bool:
        """Whether a surface of this material can emit light into the scene."""
        factor = np.array(material.emission) > 0
        if material.emission_texture is not None and factor.any():
            factor &= self.textures[material.emission_texture.texture].pixels[..., :3].any(axis=(0, 1))
        return bool(factor.any()) and not material.unlit

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Minimum and maximum corner of all triangles, two (3,) float64, m."""
        corners = np.array([mesh.bounds() for mesh in self.meshes])
        return corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)

    def diagonal(self) -> float:
        """Length of the diagonal of the bounding box, m."""
        low, high = self.bounds()
        return float(np.linalg.norm(high - low))
