"""A scene as arrays: triangles in world space, materials, punctual lights, cameras."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .camera import Camera

MAX_LIGHT = 1e15  # cd, lx or radiance: float32 holds the product of two


@dataclass(frozen=True)
class Texture:
    """`pixels` (H, W, 4) uint8 as stored in the file, row 0 on top; the slot of a material says what they mean.

    `wrap` per axis (u, v): "repeat", "mirror" or "clamp". v = 0 is the top row. Filtered bilinearly, without
    mip levels, or not at all where `nearest`.
    """

    pixels: np.ndarray
    wrap: tuple[str, str] = ("repeat", "repeat")
    nearest: bool = False


# The fields of a material that name a texture.
TEXTURE_SLOTS = ("base_color_texture", "metallic_texture", "normal_texture", "emission_texture")


@dataclass(frozen=True)
class TextureSlot:
    """A texture as a material uses it: index into `Scene.textures` and channel of `Mesh.uv`."""

    texture: int
    uv: int = 0


@dataclass(frozen=True)
class Material:
    """A Lambertian surface: albedo = base colour * (1 - metallic).

    base colour = factor * texture (sRGB) * vertex colour; metallic = factor * texture's blue (linear). `alpha_cutoff`
    None means opaque; else a point whose alpha (factor * texture * vertex colour) is below it is a hole. A single-sided
    surface (not `double_sided`) is not drawn from behind, reflects and emits nothing there, yet still stops light.
    The normal texture (linear, tangent space, xy times `normal_scale`) shapes primary light; B belongs to the
    interpolated normal. An `unlit` surface shows its base colour as radiance, has albedo 0 and lights nothing.
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

    def slots(self) -> tuple[TextureSlot, ...]:
        """The textures that it uses."""
        slots = (getattr(self, name) for name in TEXTURE_SLOTS)
        return tuple(slot for slot in slots if slot is not None)


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material, in world space, counter-clockwise seen from the front.

    position (V, 3) float32, m; normal (V, 3) float32, unit; triangle (F, 3) uint32. uv (V, C, 2) float32: one channel
    for each set and transform of texture coordinates that the material uses, transforms applied; C = 0 without
    textures. color (V, 4) float32, linear, or None for white. tangent (V, 4) float32, xyz unit and in the surface, or
    None where the material has no normal texture: bitangent = w * cross(normal, xyz), w = 1 or -1.
    """

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    triangle: np.ndarray
    material: int
    color: np.ndarray | None = None
    tangent: np.ndarray | None = None

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the triangles: two (3,) float64, m. Vertices that none uses do not count."""
        used = np.zeros(len(self.position), bool)
        used[self.triangle] = True
        corners = self.position[used].astype(np.float64)
        return corners.min(axis=0), corners.max(axis=0)


@dataclass(frozen=True)
class Light:
    """A punctual light of KHR_lights_punctual. `color` (3,) is colour * intensity: W/sr-like (cd) for point and spot,
    irradiance (lx) for directional, linear Rec.709."""

    kind: str  # "point", "spot" or "directional"
    color: np.ndarray
    position: np.ndarray  # (3,) world space, m; unused by "directional"
    direction: np.ndarray  # (3,) unit, the way light travels; unused by "point"
    range: float = np.inf  # m; no light at or beyond it
    cos_inner: float = 1.0
    cos_outer: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Environment:
    """Light from infinitely far away, all around: `radiance` (H, W, 3) float32, linear Rec.709, equirectangular.

    Row 0 is up (+Y). The middle column lies towards -Z, columns to its right towards +X; then the whole is turned by
    `rotation` (rad) about +Y, counter-clockwise seen from above. Constant within a texel. (1, 1, 3) is one colour.
    """

    radiance: np.ndarray
    rotation: float = 0.0

    @property
    def even(self) -> bool:
        """Whether it is the same in all directions."""
        return bool((self.radiance == self.radiance[0, 0]).all())


@dataclass(frozen=True)
class Scene:
    """Everything that the baker and the renderer read of a glTF file.

    `warnings` are one line each; those in `transparent`, among them, say what became of partly transparent materials.
    `files` are what it was read from: the glTF file first, buffers and images, and files that brought light.
    """

    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    environment: Environment | None = None
    cameras: dict[str, Camera] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    transparent: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    def used_materials(self) -> list[Material]:
        """The materials that some triangle has."""
        return [self.materials[index] for index in sorted({mesh.material for mesh in self.meshes})]

    def emits(self, material: Material) -> bool:
        """Whether a surface of this material lights the scene somewhere."""
        factor = np.array(material.emission) > 0
        if material.emission_texture is not None and factor.any():
            factor &= self.textures[material.emission_texture.texture].pixels[..., :3].any(axis=(0, 1))
        return bool(factor.any()) and not material.unlit

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of all triangles: two (3,) float64, m."""
        corners = np.array([mesh.bounds() for mesh in self.meshes])
        return corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)

    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, m."""
        low, high = self.bounds()
        return float(np.linalg.norm(high - low))
