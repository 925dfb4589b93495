"""A scene as arrays: triangles in world space, materials, punctual lights, cameras."""

from dataclasses import dataclass, field

import numpy as np

from .camera import Camera


@dataclass(frozen=True)
class Texture:
    """`pixels` (H, W, 4) uint8 as stored in the file (colour is sRGB, alpha linear), row 0 on top.

    `wrap` per axis (u, v): "repeat", "mirror" or "clamp". v = 0 is the top row. Filtered bilinearly.
    """

    pixels: np.ndarray
    wrap: tuple[str, str] = ("repeat", "repeat")


@dataclass(frozen=True)
class Material:
    """A Lambertian surface: albedo = base colour * (1 - metallic).

    Textures are indices into `Scene.textures` or None. `alpha_cutoff` None means opaque; else a point whose alpha
    (factor * texture) is below it is a hole. A single-sided surface (not `double_sided`) is not drawn from behind,
    reflects and emits nothing there, yet still stops light.
    """

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)  # linear
    base_color_texture: int | None = None
    metallic: float = 0.0
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)  # radiance: factor * strength
    emission_texture: int | None = None
    alpha_cutoff: float | None = None
    double_sided: bool = False


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material, in world space, counter-clockwise seen from the front.

    position (V, 3) float32, m; normal (V, 3) float32, unit; uv (V, 2) float32; triangle (F, 3) uint32.
    """

    position: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    triangle: np.ndarray
    material: int


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
class Scene:
    """Everything that the baker and the renderer read of a glTF file. `warnings` are one line each."""

    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    cameras: dict[str, Camera] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of all triangles: two (3,) float64, m."""
        used = [mesh.position[np.unique(mesh.triangle)] for mesh in self.meshes]
        points = np.concatenate(used).astype(np.float64)
        return points.min(axis=0), points.max(axis=0)

    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, m."""
        low, high = self.bounds()
        return float(np.linalg.norm(high - low))
