"""Triangles, materials and texels of a scene as flat tables that the path tracer's kernels gather from.

All materials of the scene share one set of tables, so there are no virtual calls and there is one kernel. Only features
that the scene has are stored, and only those are compiled into a kernel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsgi.runtime.errors import SceneError
from gsgi.runtime.instance import ShapeGroup
from gsgi.runtime.scene import TEXTURE_SLOTS, Material, Mesh, Scene, TextureSlot

from . import duplicates
from .planes import placed_off, traced_planes

NO_TEXTURE = 0xFFFFFFFF
WRAP = {"repeat": 0, "mirror": 1, "clamp": 2}
NEAREST = 1 << 4  # beside two bits of wrap mode per axis
UV_SHIFT = 8  # the uv channel lies above

OPAQUE, MASKED, FILTERING = range(3)  # kinds of triangles, in their order: solid, with holes, letting light through

# Triangles are flat if no component of a corner's normal differs from the triangle's by this much: 0.06 degrees.
FLAT = 1e-3


@dataclass(frozen=True)
class Placed:
    """Where the triangles of groups stand: P places in all, the n-th with number n + 1.

    rows (G, 4) int: those of each group's triangles of each kind begin there, and end. group (P,) int: the one that
    stands in a place; matrix (P, 4, 4) float64: takes its triangles there; off (P,) float64: see `planes.placed_off`.
    The number of a triangle is that of its place, 0 if it is in no group, above `bits` bits with its row in the tables.
    """

    rows: np.ndarray
    group: np.ndarray
    matrix: np.ndarray
    off: np.ndarray
    bits: int


@dataclass(frozen=True)
class Surfaces:
    """F triangles of a scene, those without alpha-tested holes first, those that let light through last.

    Triangles that others hide are left out. Those of groups follow, once each.

    position (V, 3) float32 m; triangle (F, 3) uint32; opaque: the number of triangles without holes, in no group;
    filtering: that of triangles that let light through, in no group; single: that of all in no group.
    placed: where groups stand; None without any.
    face (F, 4) float32: unit normal, and the material's index as the bits of a float.
    plane (F, 2) float32: see `planes.planes`.
    normal (F, 4) uint32: one per corner, octahedral in two signed 16-bit parts, then 0; None if all triangles are flat.
    tangent (F, 3, 4) float32: one per corner; None without normal textures.
    uv (F, C, 8) float32: u, v of each corner and two zeros. color (F, 3, 4) float32: one per corner, or None.
    albedo (M, 4): linear base colour, metallic. surface (M, 4): alpha, cut-off (-1: opaque), 1 if double-sided,
    normal scale. emission (M, 4): radiance (base colour if unlit), 1 if unlit. filters (M, 4): 1 if it lets light
    through, and the fields of its `Filter`; None if `filtering` is 0.
    slots: name -> (M, 4) uint32: first texel, width, height, modes, for each kind of texture that some material has.
    texels (T,) uint32: RGBA8, red in the lowest byte.
    """

    position: np.ndarray
    triangle: np.ndarray
    opaque: int
    filtering: int
    single: int
    placed: Placed | None
    face: np.ndarray
    plane: np.ndarray
    normal: np.ndarray | None
    tangent: np.ndarray | None
    uv: np.ndarray
    color: np.ndarray | None
    albedo: np.ndarray
    surface: np.ndarray
    emission: np.ndarray
    filters: np.ndarray | None
    slots: dict[str, np.ndarray]
    texels: np.ndarray


def tabulate(scene: Scene, groups: Sequence[ShapeGroup] = ()) -> Surfaces:
    """The tables of a scene and of groups of meshes, which use its materials and emit no light."""
    meshes = _visible(scene, _by_kind(scene, scene.meshes))
    opaque, _, filtering = _counts(scene, meshes)
    single = sum(len(mesh.triangle) for mesh in meshes)
    groups = [group._replace(meshes=tuple(_visible(scene, _by_kind(scene, group.meshes)))) for group in groups]
    placed = _placed(scene, groups, single)
    meshes += [mesh for group in groups for mesh in group.meshes]
    counts = [len(mesh.triangle) for mesh in meshes]
    first = np.cumsum([0] + [len(mesh.position) for mesh in meshes[:-1]])
    position = np.concatenate([mesh.position for mesh in meshes])
    triangle = np.concatenate([m.triangle + np.uint32(o) for m, o in zip(meshes, first, strict=True)])
    face = np.empty((len(triangle), 4), np.float32)
    face[:, :3] = face_normals(position, triangle)
    face[:, 3] = np.repeat([np.uint32(mesh.material) for mesh in meshes], counts).view(np.float32)
    slots, texels = _textures(replace(scene, meshes=tuple(meshes)))
    channels = max((slot.uv + 1 for material in scene.materials for slot in material.slots()), default=0)
    return Surfaces(
        position,
        triangle,
        opaque,
        filtering,
        single,
        placed,
        face,
        traced_planes(position, triangle),
        _corner_normals(meshes, face),
        _corners(meshes, "tangent", 4) if "normal_texture" in slots else None,
        _corner_uvs(meshes, channels),
        _corners(meshes, "color", 4, fill=1.0) if any(mesh.color is not None for mesh in meshes) else None,
        _rows(scene, lambda m: (*m.base_color[:3], m.metallic)),
        _rows(scene, _surface_row),
        _rows(scene, lambda m: (*(m.base_color[:3] if m.unlit else m.emission), float(m.unlit))),
        _rows(scene, _filter_row) if any(_kind(scene, mesh) == FILTERING for mesh in meshes) else None,
        slots,
        texels,
    )


def corners_of(position: np.ndarray, triangle: np.ndarray, placed: Placed | None, number: np.ndarray) -> np.ndarray:
    """The corners (N, 3, 3), m, of triangles with numbers (N,) where they stand; the rest is as in `Surfaces`."""
    if placed is None:
        return position[triangle[number]]
    row, place = number & np.uint32((1 << placed.bits) - 1), number >> np.uint32(placed.bits)
    matrix = np.concatenate([np.eye(4)[None], placed.matrix])[place]
    return position[triangle[row]] @ matrix[:, :3, :3].transpose(0, 2, 1) + matrix[:, None, :3, 3]


def rows_with(position: np.ndarray, triangle: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The first of the triangles (F, 3) that has each of these `corners` (N, 3, 3) float32, or -1: (N,) int64."""
    found = {each.tobytes(): -1 for each in corners}
    some = np.isin(_hashed(position), _hashed(corners[:, 0]))
    for row in np.flatnonzero(some[triangle[:, 0]])[::-1]:
        key = position[triangle[row]].tobytes()
        if key in found:
            found[key] = int(row)
    return np.array([found[each.tobytes()] for each in corners], np.int64)


def _hashed(position: np.ndarray) -> np.ndarray:
    """A number (N,) uint64 for each position (N, 3) float32, the same for the same bits."""
    x, y, z = np.ascontiguousarray(position, np.float32).view(np.uint32).astype(np.uint64).T
    return (x * np.uint64(0x9E3779B97F4A7C15) ^ y) * np.uint64(0xC2B2AE3D27D4EB4F) ^ z


def _by_kind(scene: Scene, meshes: Sequence[Mesh]) -> list[Mesh]:
    return sorted(meshes, key=lambda mesh: _kind(scene, mesh))


def _counts(scene: Scene, meshes: Sequence[Mesh]) -> list[int]:
    """The number of triangles of each kind."""
    return [sum(len(mesh.triangle) for mesh in meshes if _kind(scene, mesh) == kind) for kind in range(3)]


def _placed(scene: Scene, groups: Sequence[ShapeGroup], single: int) -> Placed | None:
    """Where groups stand whose triangles follow `single` others. Raises SceneError for too many."""
    if not groups:
        return None
    counts = np.array([_counts(scene, group.meshes) for group in groups])
    ends = single + np.cumsum(counts).reshape(counts.shape)
    group = np.repeat(np.arange(len(groups)), [len(each.places) for each in groups])
    bits = int(ends[-1, -1]).bit_length()
    if (len(group) + 1) << bits > 1 << 32:
        raise SceneError(f"{ends[-1, -1]} triangles and {len(group)} places of copies: their product is beyond 2^32")
    rows = np.concatenate([(ends - counts)[:, :1], ends], axis=1)
    boxes = [np.array([[m.position.min(axis=0), m.position.max(axis=0)] for m in each.meshes]) for each in groups]
    boxes = [np.array([box[:, 0].min(axis=0), box[:, 1].max(axis=0)]) for box in boxes]
    off = [placed_off(matrix, box) for each, box in zip(groups, boxes, strict=True) for matrix in each.places]
    return Placed(rows, group, np.concatenate([each.places for each in groups]), np.array(off), bits)


def _visible(scene: Scene, meshes: list[Mesh]) -> list[Mesh]:
    """The meshes without triangles that stand there twice (see `duplicates`); those with holes, or filters, stay."""
    solid = [mesh for mesh in meshes if _kind(scene, mesh) == OPAQUE]
    if not solid:
        return meshes
    counts = [len(mesh.triangle) for mesh in solid]
    first = np.cumsum([0] + [len(mesh.position) for mesh in solid[:-1]])
    materials = [scene.materials[mesh.material] for mesh in solid]
    kept = duplicates.visible(
        np.concatenate([mesh.position for mesh in solid]),
        np.concatenate([mesh.triangle + np.uint32(at) for mesh, at in zip(solid, first, strict=True)]),
        np.repeat([scene.emits(material) for material in materials], counts),
        np.repeat([material.double_sided for material in materials], counts),
    )
    parts = np.split(kept, np.searchsorted(kept, np.cumsum(counts)[:-1]))
    starts = np.cumsum([0, *counts[:-1]])
    there = [replace(m, triangle=m.triangle[part - at]) for m, part, at in zip(solid, parts, starts, strict=True)]
    return [*there, *meshes[len(solid) :]]


def _kind(scene: Scene, mesh: Mesh) -> int:
    material = scene.materials[mesh.material]
    if material.filter is not None:
        return FILTERING
    return OPAQUE if material.alpha_cutoff is None else MASKED


def face_normals(position: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3) float64, 0 for triangles of area 0."""
    a, b, c = (position[triangle[:, i]].astype(np.float64) for i in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)


def _corner_normals(meshes: list, face: np.ndarray) -> np.ndarray | None:
    corner = np.concatenate([mesh.normal[mesh.triangle] for mesh in meshes])
    if np.abs(corner - face[:, None, :3]).max(initial=0) < FLAT:
        return None
    packed = np.zeros((len(corner), 4), np.uint32)
    packed[:, :3] = _octahedral(corner)
    return packed


def _octahedral(normal: np.ndarray) -> np.ndarray:
    """Unit normals (..., 3) as two signed 16-bit numbers in a uint32, x in the low half (Cigolle et al. 2014)."""
    n = normal / np.abs(normal).sum(axis=-1, keepdims=True)
    folded = (1 - np.abs(n[..., 1::-1])) * np.where(n[..., :2] >= 0, 1, -1)
    p = np.where(n[..., 2:] < 0, folded, n[..., :2])
    codes = np.rint(p * 32767).astype(np.int16).view(np.uint16).astype(np.uint32)
    return codes[..., 0] | codes[..., 1] << np.uint32(16)


def _corners(meshes: list, name: str, width: int, fill: float = 0.0) -> np.ndarray:
    """A vertex attribute at each corner (F, 3, width) float32; `fill` for meshes that lack it."""
    absent = np.float32(fill)
    columns = []
    for mesh in meshes:
        values = getattr(mesh, name)
        shape = (len(mesh.triangle), 3, width)
        columns.append(np.full(shape, absent) if values is None else values[mesh.triangle])
    return np.concatenate(columns)


def _corner_uvs(meshes: list, channels: int) -> np.ndarray:
    columns = [np.zeros((len(mesh.triangle), channels, 8), np.float32) for mesh in meshes]
    for column, mesh in zip(columns, meshes, strict=True):
        for channel in range(min(channels, mesh.uv.shape[1])):
            column[:, channel, :6] = mesh.uv[mesh.triangle, channel].reshape(-1, 6)
    return np.concatenate(columns)


def _rows(scene: Scene, row) -> np.ndarray:
    return np.array([row(material) for material in scene.materials], np.float32).reshape(-1, 4)


def _surface_row(material: Material) -> tuple[float, float, float, float]:
    cutoff = -1.0 if material.alpha_cutoff is None else material.alpha_cutoff
    return material.base_color[3], cutoff, float(material.double_sided), material.normal_scale


def _filter_row(material: Material) -> tuple[float, float, float, float]:
    of = material.filter
    return (0.0, 0.0, -1.0, 0.0) if of is None else (of.clear, float(of.blends), of.transmission, float(of.stained))


def _textures(scene: Scene) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The tables `slots`, and the texels of all textures that they refer to."""
    used = sorted({slot.texture for material in scene.used_materials() for slot in material.slots()})
    pixels = [np.ascontiguousarray(scene.textures[index].pixels) for index in used]
    first = dict(zip(used, np.cumsum([0] + [p.size // 4 for p in pixels]), strict=False))
    tables = {name: np.full((len(scene.materials), 4), NO_TEXTURE, np.uint32) for name in TEXTURE_SLOTS}
    for row, material in enumerate(scene.materials):
        for name in TEXTURE_SLOTS:
            slot = getattr(material, name)
            if slot is not None and slot.texture in first:
                tables[name][row] = _slot_row(scene, slot, first[slot.texture])
    present = {name: table for name, table in tables.items() if (table != NO_TEXTURE).any()}
    texels = np.concatenate([p.reshape(-1, 4).view("<u4")[:, 0] for p in pixels]) if pixels else np.zeros(0, "<u4")
    return present, texels


def _slot_row(scene: Scene, slot: TextureSlot, first: int) -> tuple[int, int, int, int]:
    texture = scene.textures[slot.texture]
    height, width = texture.pixels.shape[:2]
    u, v = (WRAP[mode] for mode in texture.wrap)
    return first, width, height, u | v << 2 | NEAREST * texture.nearest | slot.uv << UV_SHIFT
