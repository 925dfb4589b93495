"""Effects: what a scene contains that costs time to light. They are found by inspection and left out on request."""

import math
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, replace

from gsgi.runtime.environment_sun import find_sun
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.metals import has_metal, metal_areas
from gsgi.runtime.scene import Material, Scene

from .settings import EFFECTS

# The flag that stands for each of EFFECTS in a file.
NAMES = {name: Effects[name.upper().replace("-", "_")] for name in EFFECTS}

SHADOW_KINDS = {"directional": "one shadow map", "spot": "one shadow map", "point": "a shadow cube (six maps)"}


@dataclass(frozen=True)
class Finding:
    """One effect: how much of it the scene has ("none" if nothing), and what that costs the bake and the frame."""

    name: str
    found: str
    cost: str


def effects(scene: Scene) -> Effects:
    """The effects that `scene` has."""
    found = Effects(0)
    for name, flag in NAMES.items():
        if scene.lights if name == "punctual" else scene.environment if name == "environment" else _has(scene, name):
            found |= flag
    if scene.metals == "rough" and has_metal(scene):
        found |= Effects.METAL
    if scene.lights and any(material.filter and material.filter.clear for material in scene.used_materials()):
        found |= Effects.CLEAR_PANE
    return found


def without(scene: Scene, names: Collection[str]) -> Scene:
    """Return `scene` without the effects `names` (keys of NAMES)."""
    change = {
        "emissive": {"emission": (0.0, 0.0, 0.0), "emission_texture": None},
        "alpha-mask": {"alpha_cutoff": None},
        "double-sided": {"double_sided": False},
        "normal-map": {"normal_texture": None},
        "unlit": {"unlit": False},
    }
    changes = {field: value for name in names for field, value in change.get(name, {}).items()}
    return replace(
        scene,
        materials=tuple(replace(material, **changes) for material in scene.materials),
        lights=() if "punctual" in names else scene.lights,
        environment=None if "environment" in names else scene.environment,
    )


def findings(scene: Scene) -> list[Finding]:
    """Return a finding for every effect, present or not; one for metals only if there are some."""
    # At each surface a path casts one ray to continue, and one more for each kind of light that is sampled.
    picture = scene.environment is not None and not scene.environment.even
    rays = 1 + bool(scene.lights) + _has(scene, "emissive") + picture
    share = f"1 of the {rays} rays that a path casts at each surface"
    return [
        *(_punctual(scene, kind, share) for kind in ("point", "spot", "directional")),
        _surfaces(scene, "emissive", "emissive surfaces", f"{share} samples a point on them"),
        _environment(scene, share),
        _surfaces(scene, "alpha-mask", "alpha masks", "every ray tests for holes; shadow maps test alpha"),
        _surfaces(scene, "double-sided", "double-sided", "drawn without back-face culling"),
        _surfaces(scene, "normal-map", "normal maps", "B follows them with `surface`: Gaussians take more bytes"),
        _transparent(scene),
        _surfaces(scene, "unlit", "unlit", "shown unshaded: they light nothing and have no B"),
        *_metals(scene),
    ]


def _punctual(scene: Scene, kind: str, share: str) -> Finding:
    count = sum(light.kind == kind for light in scene.lights)
    cost = f"{share} samples a punctual light; a frame draws {SHADOW_KINDS[kind]} for each"
    return Finding(f"{kind} lights", str(count) if count else "none", cost if count else "")


def _environment(scene: Scene, share: str) -> Finding:
    if scene.environment is None:
        return Finding("environment", "none", "")
    if scene.environment.even:
        return Finding("environment", "one colour", "no extra ray: rays that leave the scene see it")
    height, width = scene.environment.radiance.shape[:2]
    cost = f"{share} samples a bright part of it"
    if sun := find_sun(scene.environment.radiance):
        cost += f"; its sun has {sun.share:.0%} of the light: --sun env makes it a directional light with sharp shadows"
    return Finding("environment", f"image of {width} x {height}", cost)


def _transparent(scene: Scene) -> Finding:
    """Blending and transmission: what lets light through, or else what the reader has put in its place."""
    if not scene.transparent:
        return Finding("transparent", "none", "")
    filters = [(material.name or f"material {i}", material.filter) for i, material in enumerate(scene.materials)]
    names = [name for name, of in filters if of]
    if names:
        more = ", ..." if len(names) > 3 else ""
        clear = [name if of.clear == math.inf else f"{name} in part" for name, of in filters if of and of.clear]
        cost = f"let light through: every ray goes on behind them ({', '.join(names[:3])}{more})"
        cost += f"; what is clear is to cast no shadow ({', '.join(clear)})" if clear else ""
        return Finding("transparent", f"{len(names)} materials", cost)
    more = ", ..." if len(scene.transparent) > 1 else ""
    return Finding("transparent", f"{len(scene.transparent)} materials", scene.transparent[0] + more)


def _metals(scene: Scene) -> list[Finding]:
    metal, area = metal_areas(scene)
    if not metal.any():
        return []
    names = [scene.materials[index].name or f"material {index}" for index in metal.argsort()[::-1][:3] if metal[index]]
    what = {"rough": "reflect as rough ones would on average, diffusely", "black": "reflect nothing and have no B"}
    more = ", ..." if (metal > 0).sum() > len(names) else ""
    cost = f"{what[scene.metals]} ({', '.join(names)}{more})"
    return [Finding("metals", f"{metal.sum() / area:.1%} of all surface", cost)]


def _surfaces(scene: Scene, effect: str, name: str, cost: str) -> Finding:
    triangles = Counter()
    for mesh in scene.meshes:
        if _shows(scene.materials[mesh.material], scene, effect):
            triangles[mesh.material] += len(mesh.triangle)
    if not triangles:
        return Finding(name, "none", "")
    names = [scene.materials[index].name or f"material {index}" for index, _ in triangles.most_common(3)]
    more = ", ..." if len(triangles) > 3 else ""
    return Finding(name, f"{triangles.total()} triangles", f"{cost} ({', '.join(names)}{more})")


def _has(scene: Scene, effect: str) -> bool:
    return any(_shows(material, scene, effect) for material in scene.used_materials())


def _shows(material: Material, scene: Scene, effect: str) -> bool:
    match effect:
        case "emissive":
            return scene.emits(material)
        case "alpha-mask":
            return material.alpha_cutoff is not None and material.filter is None
        case "double-sided":
            return material.double_sided
        case "normal-map":
            return material.normal_texture is not None
        case "unlit":
            return material.unlit
    raise AssertionError(effect)
