"""Light groups: sets of lights whose light is baked apart, so that they can be switched and recoloured afterwards."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from glob import escape

import numpy as np

from .errors import SceneError
from .gaussians import Bake, LightGroup
from .scene import MAX_LIGHT, Environment, Light, Material, Scene

BASE = "base"  # the group of all lights that no pattern matches
ENVIRONMENT = "environment"  # what a pattern calls the environment; the sun of `Lighting` is a light called "sun"
GROUPS_MOST, PATTERNS_MOST = 255, 255  # of a bake, and of a group
NAME_MOST, PATTERN_MOST = 255, 65535  # bytes of UTF-8

Patterns = Mapping[str, Sequence[str]]  # of each group, by its name
Weight = float | Sequence[float]  # of all channels, or of each: linear Rec.709
Weights = Mapping[str, Weight]  # by the names of groups; 1 for those that are left out
Factors = Mapping[str, tuple[float, float, float]]  # of every group


def sources(scene: Scene) -> list[Light | Material | Environment]:
    """All that emits light in a scene: punctual lights, materials that emit and are used, the environment."""
    environment = [] if scene.environment is None else [scene.environment]
    return [*scene.lights, *(m for m in scene.used_materials() if scene.emits(m)), *environment]


def names_of(source: Light | Material | Environment) -> tuple[str, ...]:
    """What patterns can call a source of light; () for one without a name."""
    if isinstance(source, Environment):
        return (ENVIRONMENT,)
    names = (source.name, source.entry) if isinstance(source, Light) else (source.name,)
    return tuple(name for name in dict.fromkeys(names) if name)


def matches(names: Iterable[str], pattern: str) -> bool:
    """Whether a pattern (`*`, `?`, `[abc]`; upper and lower case differ) matches one of the names of a source."""
    return any(fnmatchcase(name, pattern) for name in names)


def group_of(names: Iterable[str], groups: Patterns) -> str:
    """The group of a source with these names: the first that has a matching pattern, else BASE."""
    names = tuple(names)
    return next((name for name, patterns in groups.items() if any(matches(names, p) for p in patterns)), BASE)


def with_each(scene: Scene, groups: Patterns) -> dict[str, tuple[str, ...]]:
    """The groups, and one more for each name of a light that none of them has.

    Lights with one name share a group. Raises SceneError for a light without a name, and for one with the name of a
    group.
    """
    result = {name: tuple(patterns) for name, patterns in groups.items()}
    for source in sources(scene):
        names = names_of(source)
        if names and group_of(names, result) != BASE:
            continue
        if not names:
            raise SceneError(f"{_kind(source)}: expected a name, since it is to be a group of its own, got none")
        if names[0] in result:
            raise SceneError(f"group {names[0]!r}: expected one, but the {_kind(source)} of that name is to be one too")
        result[names[0]] = (escape(names[0]),)
    return result


def check_groups(scene: Scene) -> None:
    """Raise SceneError, with the name of the group, for groups of the scene that cannot be baked.

    These are: a name that is empty, reserved or too long, a group without a pattern or with too many, a pattern that
    matches nothing in the scene or is too long, a light in two groups, and more than GROUPS_MOST groups, the one of all
    other lights included.
    """
    there = [(source, names_of(source)) for source in sources(scene)]
    if len(scene.groups) >= GROUPS_MOST:
        raise SceneError(f"groups: expected at most {GROUPS_MOST - 1}, got {len(scene.groups)}")
    for name, patterns in scene.groups.items():
        check_name(name)
        if not 0 < len(patterns) <= PATTERNS_MOST:
            raise SceneError(f"group {name!r}: expected 1 to {PATTERNS_MOST} patterns, got {len(patterns)}")
        for pattern in patterns:
            if not pattern.isprintable() or len(pattern.encode()) > PATTERN_MOST:
                expected = f"a pattern of at most {PATTERN_MOST} bytes that can be printed"
                raise SceneError(f"group {name!r}: expected {expected}, got {pattern[:40]!r}")
            if not any(matches(names, pattern) for _, names in there):
                known = ", ".join(dict.fromkeys(repr(n[0]) for _, n in there if n)) or "none with a name"
                raise SceneError(f"group {name!r}: expected a pattern that matches a light ({known}), got {pattern!r}")
    for source, names in there:
        having = [name for name, patterns in scene.groups.items() if any(matches(names, p) for p in patterns)]
        if len(having) > 1:
            raise SceneError(f"{_kind(source)} {names[0]!r}: expected one group, got {', '.join(map(repr, having))}")


def check_name(name: str) -> None:
    """Raise SceneError for what cannot be the name of a group."""
    if name == BASE:
        raise SceneError(f"group {name!r}: expected another name: this one is that of all lights without a group")
    if not name or not name.isprintable() or len(name.encode()) > NAME_MOST:
        raise SceneError(f"group {name!r}: expected a name of 1 to {NAME_MOST} bytes that can be printed")


def lit_groups(scene: Scene) -> list[str]:
    """The names of the groups that emit light, BASE first."""
    having = {group_of(names_of(source), scene.groups) for source in sources(scene)}
    return [name for name in (BASE, *scene.groups) if name in having]


def lit_by(scene: Scene, group: str) -> Scene:
    """The scene with only the lights of one group."""
    names = {BASE, *scene.groups}
    return dimmed(scene, scene.groups, {name: (float(name == group),) * 3 for name in names})


def factor_on(source: Light | Material | Environment, groups: Patterns, factors: Factors) -> np.ndarray:
    """The factor (3,) on the light of a source: that of its group."""
    return np.array(factors[group_of(names_of(source), groups)])


def dimmed(scene: Scene, groups: Patterns, factors: Factors) -> Scene:
    """The scene with the light of each group multiplied by its factor; lights whose factor is 0 are left out."""
    environment = scene.environment
    if environment is not None:
        by = factor_on(environment, groups, factors)
        radiance = (environment.radiance * by).astype(np.float32)
        environment = dataclasses.replace(environment, radiance=radiance) if by.any() else None
    return dataclasses.replace(
        scene,
        lights=dimmed_lights(scene.lights, groups, factors),
        materials=tuple(
            dataclasses.replace(m, emission=tuple((np.array(m.emission) * factor_on(m, groups, factors)).tolist()))
            for m in scene.materials
        ),
        environment=environment,
    )


def dimmed_lights(lights: Iterable[Light], groups: Patterns, factors: Factors) -> tuple[Light, ...]:
    """Punctual lights, each multiplied by the factor of its group; those whose factor is 0 are left out."""
    both = ((light, factor_on(light, groups, factors)) for light in lights)
    return tuple(dataclasses.replace(light, color=light.color * by) for light, by in both if by.any())


def group_names(bake: Bake) -> tuple[str, ...]:
    """The names that `weights` of a bake may have, BASE first; none for a bake without groups."""
    return (BASE, *(group.name for group in bake.groups if group.name != BASE)) if bake.groups else ()


def patterns_of(bake: Bake | None) -> dict[str, tuple[str, ...]]:
    """The patterns of a bake's groups, by name."""
    return {group.name: group.patterns for group in (bake.groups if bake else ()) if group.name != BASE}


def factors_of(bake: Bake, weights: Weights) -> dict[str, tuple[float, float, float]]:
    """The factor of each of the bake's groups.

    Raises ValueError for an unknown name, which lists the known ones, for a weight that is neither a number from 0 to
    1e15 nor three, and for weights without names.
    """
    if not isinstance(weights, Mapping):
        raise ValueError(f"weights: expected weights by the names of light groups, got {type(weights).__name__}")
    known = group_names(bake)
    factors = dict.fromkeys(known, (1.0, 1.0, 1.0))
    for name, weight in weights.items():
        if name not in factors:
            listed = f"it has {', '.join(map(repr, known))}" if known else "it was baked without groups"
            raise ValueError(f"weights: the bake has no light group {name!r}: {listed}")
        try:
            value = np.array(weight)
        except ValueError:  # of several lengths
            value = np.array(None)
        is_number = value.dtype.kind in "biuf" and value.shape in ((), (3,))
        if not is_number or not ((value >= 0) & (value <= MAX_LIGHT)).all():
            expected = f"one or three numbers from 0 to {MAX_LIGHT:g}"
            raise ValueError(f"weights: {name!r}: expected {expected}, got {weight!r}")
        factors[name] = tuple(np.broadcast_to(value.astype(np.float64), 3).tolist())
    return factors


def weighted(bake: Bake, weights: Weights) -> Bake:
    """The bake with the light of each group multiplied by its weight; other fields are kept.

    Colours of both levels are the bake's own, multiplied by the least of the weights, and those of each group,
    multiplied by what its weight is above that: the groups alone do not add up to the bake exactly, and light must not
    jump when a weight leaves 1. A Gaussian's slopes become those that change the sum as the slopes of its parts do, as
    far as one pair for all channels can (least squares). Relief follows the colours. With weights of 1 the bake is
    returned as it is. Raises ValueError as `factors_of` does.
    """
    factors = factors_of(bake, weights)
    factor = np.float32([factors[group.name] for group in bake.groups])
    if (factor == 1).all():
        return bake
    least = factor.min(axis=0)
    whole = LightGroup(BASE, (), bake.gaussians.sh, bake.gaussians.slope, bake.coarse.sh)
    sh, coarse = np.zeros_like(whole.sh), np.zeros_like(whole.coarse_sh)
    gradient = np.zeros((*whole.slope.shape, 3), np.float32)
    for part, times in zip((whole, *bake.groups), (least, *(factor - least)), strict=True):
        sh += times * part.sh
        coarse += times * part.coarse_sh
        gradient += part.slope[:, :, None] * (times * part.sh[:, :1])
    constant = sh[:, :1]
    square = np.square(constant).sum(axis=2)
    along = (gradient * constant).sum(axis=2)
    slope = np.divide(along, square, out=np.zeros_like(along), where=square > 0)
    before = bake.gaussians.sh[:, :1]
    relief = bake.gaussians.relief * np.divide(constant, before, out=np.zeros_like(before), where=before > 0)
    return dataclasses.replace(
        bake,
        gaussians=dataclasses.replace(bake.gaussians, sh=sh, slope=slope, relief=relief),
        coarse=dataclasses.replace(bake.coarse, sh=coarse),
    )


def _kind(source: Light | Material | Environment) -> str:
    if isinstance(source, Light):
        return f"{source.kind} light"
    return "emissive material" if isinstance(source, Material) else "environment"
