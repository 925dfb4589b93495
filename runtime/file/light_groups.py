"""Light groups of a .gsgi file: a section for each, with its name, its patterns, and its light on both levels."""

from dataclasses import replace

import numpy as np

from gsgi.runtime.gaussians import Bake, LightGroup
from gsgi.runtime.light_groups import BASE, GROUPS_MOST, NAME_MOST, PATTERN_MOST, PATTERNS_MOST

from .codes import quantise
from .levels import Expect, decode_group_light, encode_light

GROUP = np.dtype(
    [("light_steps", "u1"), ("sh_steps", "u1"), ("slope_steps", "u1"), ("name_bytes", "u1"), ("pattern_count", "u1")]
)
GROUP_BYTES, COARSE_BYTES = 4.0, 11.0  # that a group hardly exceeds, per Gaussian of the fine and of the coarse level

# Coarser than those of a level, since the light of a group is seen beside that of others, and a bake makes up for them.
GROUP_STEPS = {"light_steps": 7, "sh_steps": 6, "slope_steps": 13}


def encode_group(group: LightGroup, bake: Bake, levels: list[np.ndarray], orders: list[np.ndarray]) -> bytes:
    """The content of a group's section; `levels` are the LEVEL records of both levels, in these `orders` (N,)."""
    name, patterns = group.name.encode(), [pattern.encode() for pattern in group.patterns]
    assert _is_name(group.name), group.name
    assert len(name) <= NAME_MOST, group.name
    assert len(patterns) <= PATTERNS_MOST, group.name
    assert all(len(pattern) <= PATTERN_MOST for pattern in patterns), group.name
    content = np.array((*GROUP_STEPS.values(), len(name), len(patterns)), GROUP).tobytes() + name
    for pattern in patterns:
        content += len(pattern).to_bytes(2, "little") + pattern
    fine = replace(bake.gaussians, sh=group.sh, slope=group.slope)
    coarse = replace(bake.coarse, sh=group.coarse_sh)
    for gaussians, level, order, facing in zip((fine, coarse), levels, orders, (True, False), strict=True):
        assert np.isfinite(gaussians.sh).all(), group.name
        assert np.isfinite(gaussians.slope).all(), group.name
        record = _with(level, GROUP_STEPS)
        content += encode_light(quantise(gaussians, record, facing, of_group=True)[order], record, of_group=True)
    return content


def decode_groups(
    data: bytes, sections: list[tuple[int, int]], levels: list[np.ndarray], expect: Expect
) -> tuple[LightGroup, ...]:
    """The groups whose sections take these bytes of `data`: (first, the one after the last)."""
    groups: dict[str, LightGroup] = {}
    for at, end in sections:
        expect(len(groups) < GROUPS_MOST, at, "group", f"at most {GROUPS_MOST} groups")
        group = _decode(data, at, end, levels, expect)
        expect(group.name not in groups, at, "group.name", f"another name than {group.name!r}, which is taken")
        groups[group.name] = group
    return tuple(groups.values())


def _decode(data: bytes, at: int, end: int, levels: list[np.ndarray], expect: Expect) -> LightGroup:
    start = at
    expect(at + GROUP.itemsize <= end, at, "group", f"{GROUP.itemsize} bytes")
    head = np.frombuffer(data, GROUP, 1, at)[0]
    for field in GROUP_STEPS:
        expect(head[field] > 0, at, f"group.{field}", "at least 1")
    at += GROUP.itemsize
    name, at = _text(data, at, end, int(head["name_bytes"]), "group.name", expect)
    expect(_is_name(name), start, "group.name", "a name that can be printed")
    patterns = []
    for _ in range(head["pattern_count"]):
        expect(at + 2 <= end, at, "group.pattern", "2 bytes")
        pattern, at = _text(data, at + 2, end, int.from_bytes(data[at : at + 2], "little"), "group.pattern", expect)
        patterns.append(pattern)
    expect((name == BASE) == (not patterns), start, "group.pattern_count", f"patterns for all groups but {BASE!r}")
    lights = []
    for level, which in zip(levels, ("fine", "coarse"), strict=True):
        sh, slope, at = decode_group_light(_with(level, head), data, at, end, f"group.{which}", expect)
        lights.append((sh, slope))
    expect(at == end, at, "group", "the end of the section")
    (sh, slope), (coarse_sh, _) = lights
    return LightGroup(name, tuple(patterns), sh, slope, coarse_sh)


def _is_name(name: str) -> bool:
    """Whether it has characters, none of which controls. Which others can be printed depends on Unicode's version."""
    return name != "" and not any(ord(each) < 0x20 or 0x7F <= ord(each) < 0xA0 for each in name)


def _text(data: bytes, at: int, end: int, size: int, field: str, expect: Expect) -> tuple[str, int]:
    expect(at + size <= end, at, field, f"{size} bytes")
    try:
        return data[at : at + size].decode(), at + size
    except UnicodeDecodeError:
        expect(False, at, field, "UTF-8")


def _with(level: np.ndarray, steps) -> np.ndarray:
    """A LEVEL record with the steps of a group's light."""
    result = level.copy()
    for field in GROUP_STEPS:
        result[field] = steps[field]
    return result
