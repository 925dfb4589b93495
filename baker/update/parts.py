"""The parts of a scene by name, and which of them an edit has changed."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.cache.digest import digest, digests
from gsgi.runtime.scene import TEXTURE_SLOTS, Material, Mesh, Scene
from gsgi.runtime.world.boxes import touch

NAMED = 4  # most names of one kind in a line
BOXES = 16  # that lines of sight are compared with; it takes longer with more than to follow the lines again


@dataclass(frozen=True)
class Part:
    """One part of a scene: its `kind` ("object", "material", "light", ...), its `name`, and the digest of what it is.

    `area` is that of an object's surfaces, m^2, and 0 for all else. `met` is the digest of what decides where rays meet
    an object, and with which normal, and "" for all else. `box` has the lowest and the highest corner of an object, m,
    and is empty for all else.
    """

    kind: str
    name: str
    digest: str
    area: float = 0.0
    met: str = ""
    box: tuple[float, ...] = ()


def parts(scene: Scene) -> list[Part]:
    """All parts of a scene that light depends on. Objects, materials and lights of the same name may occur often."""
    names = [material.name or f"material {number}" for number, material in enumerate(scene.materials)]
    met = [digest(_filled(scene, _uncoloured(material))) for material in scene.materials]
    shapes = digests([replace(mesh, material=0, name="") for mesh in scene.meshes])
    result = [
        _object(mesh, shape, names[mesh.material], met[mesh.material])
        for mesh, shape in zip(scene.meshes, shapes, strict=True)
    ]
    result += [
        Part("material", name, digest(_filled(scene, material)))
        for name, material in zip(names, scene.materials, strict=True)
    ]
    for number, light in enumerate(scene.lights):
        of = replace(light, name="", entry="")
        result.append(Part("light", light.name or f"light {number}", digest(of)))
    if scene.environment is not None:
        result.append(Part("environment", "environment", digest(scene.environment)))
    return [*result, Part("metals", scene.metals, scene.metals)]


def changes(before: list[Part], after: list[Part]) -> list[str]:
    """One line for each kind of part that an edit has changed, added or removed, by name; empty if there is none."""
    lines = []
    for kind in dict.fromkeys(part.kind for part in (*after, *before)):
        old, new = (_by_name(parts, kind) for parts in (before, after))
        edits = {
            "changed": [name for name in new if name in old and new[name] != old[name]],
            "added": [name for name in new if name not in old],
            "removed": [name for name in old if name not in new],
        }
        lines += [f"{verb}: {_listed(kind, names)}" for verb, names in edits.items() if names]
    return lines


def kept_share(before: list[Part], after: list[Part], box: np.ndarray | None = None) -> float:
    """The share of the area of a scene's surfaces whose objects are those of the scene `before`.

    With a box (2, 3), m, that of the objects that reach into it.
    """
    known = {part.digest for part in before}
    there = [part for part in after if part.box]
    if box is not None:
        bounds = np.array([part.box for part in there]).reshape(-1, 2, 3)
        there = [part for part, met in zip(there, touch(bounds, box), strict=True) if met]
    total = sum(part.area for part in there)
    return sum(part.area for part in there if part.digest in known) / total if total else 0.0


def met_anew(before: list[Part], after: list[Part]) -> np.ndarray:
    """Boxes (B, 2, 3), m, around what rays do not meet as before an edit; of many, the one around them."""
    old, new = (Counter((part.met, part.box) for part in parts if part.met) for parts in (before, after))
    boxes = np.array([box for _, box in (*(old - new), *(new - old))]).reshape(-1, 2, 3)
    return boxes if len(boxes) <= BOXES else np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])[None]


def _object(mesh: Mesh, shape: str, material: str, met: str) -> Part:
    """The part of a mesh; which material it has counts, but not what that is like, except for what rays have `met`."""
    part = digest({"mesh": shape, "material": material})
    box = tuple(np.ravel(mesh.bounds()).tolist())
    return Part("object", mesh.name or material, part, float(mesh.areas().sum()), digest((shape, met)), box)


def _uncoloured(material: Material) -> Material:
    """A material without what changes light alone, and no point that a ray meets."""
    alpha = float(material.base_color[3])
    return replace(material, base_color=(0, 0, 0, alpha), emission=(0, 0, 0), emission_texture=None)


def _filled(scene: Scene, material: Material) -> tuple:
    """A material with its textures in place of their indices."""
    slots = (getattr(material, name) for name in TEXTURE_SLOTS)
    textures = [None if slot is None else (slot.uv, scene.textures[slot.texture]) for slot in slots]
    return replace(material, name="", **dict.fromkeys(TEXTURE_SLOTS)), textures


def _by_name(parts: list[Part], kind: str) -> dict[str, list[str]]:
    """The digests of all parts of a kind, by name, in an order that does not matter."""
    found: dict[str, list[str]] = {}
    for part in parts:
        if part.kind == kind:
            found.setdefault(part.name, []).append(part.digest)
    return {name: sorted(digests) for name, digests in found.items()}


def _listed(kind: str, names: list[str]) -> str:
    shown = ", ".join(names[:NAMED])
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{kind} {shown}{more}" if kind != "environment" else kind


def as_arrays(parts: list[Part]) -> list[list]:
    """Parts as lists that JSON holds."""
    return [[part.kind, part.name, part.digest, part.area, part.met, part.box] for part in parts]


def from_arrays(arrays: list[list]) -> list[Part]:
    """The parts that `as_arrays` took apart."""
    return [Part(*values, tuple(box)) for *values, box in arrays]
