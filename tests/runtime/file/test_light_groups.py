"""Light groups in a .gsgi file: what they hold comes back, and what the encoder cannot have written is refused."""

from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import example, reseal, surface_example
from surface_cases import grouped, points

import gsgi
from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import GROUP_TAG, HEADER, section
from gsgi.runtime.file.light_groups import GROUP, GROUP_STEPS
from gsgi.runtime.gaussians import Bake, LightGroup


def bake() -> Bake:
    """Its shapes are as a file holds them, so that only light is rounded."""
    return grouped(codec.decode(codec.encode(surface_example())))


def plain(data: bytes) -> bytes:
    """The same file without its groups."""
    return reseal(data[: len(codec.encode(replace(codec.decode(data), groups=())))])


def with_group(content: bytes) -> bytes:
    """A file with one group of this content."""
    return reseal(codec.encode(surface_example()) + section(GROUP_TAG, content))


def refused(data: bytes) -> str:
    with pytest.raises(FormatError) as raised:
        codec.decode(data)
    return str(raised.value)


def content(**changes) -> bytearray:
    """The content of the section of a group without light, called "lamps"."""
    black = LightGroup("lamps", ("a*", "ü"), *(np.zeros_like(a) for a in (FINE.sh, FINE.slope, COARSE.sh)))
    data = codec.encode(replace(surface_example(), groups=(replace(black, **changes),)))
    return bytearray(data[len(codec.encode(surface_example())) + 8 :])


FINE, COARSE = surface_example().gaussians, surface_example().coarse


def test_rounded_light_is_that_of_the_file_and_stays():
    made = bake()
    order, coarse_order = (np.lexsort(level.position.T) for level in (made.gaussians, made.coarse))
    group = made.groups[1]
    fine = codec.stored_group(replace(made.gaussians, sh=group.sh, slope=group.slope))
    coarse = codec.stored_group(replace(made.coarse, sh=group.coarse_sh), fine=False)
    rounded = replace(group, sh=fine.sh, slope=fine.slope, coarse_sh=coarse.sh)
    again = codec.stored_group(fine)
    np.testing.assert_array_equal(again.sh, fine.sh)
    np.testing.assert_array_equal(again.slope, fine.slope)
    np.testing.assert_array_equal(codec.stored_group(coarse, fine=False).sh, coarse.sh)
    for written in (group, rounded):
        read = codec.decode(codec.encode(replace(made, groups=(written,))))
        found, coarse_found = (np.lexsort(level.position.T) for level in (read.gaussians, read.coarse))
        np.testing.assert_array_equal(read.groups[0].sh[found], fine.sh[order])
        np.testing.assert_array_equal(read.groups[0].slope[found], fine.slope[order])
        np.testing.assert_array_equal(read.groups[0].coarse_sh[coarse_found], coarse.sh[coarse_order])


def test_light_names_and_patterns_come_back():
    """Light to half a step of its own: black stays black, and light a thousand times fainter is as exact."""
    made = bake()
    dim = replace(made.groups[1], sh=made.groups[1].sh * np.float32(1e-6), coarse_sh=made.groups[1].coarse_sh * 0)
    made = replace(made, groups=(made.groups[0], dim, made.groups[2]))
    read = codec.decode(codec.encode(made))
    assert [(group.name, group.patterns) for group in read.groups] == [
        ("base", ()), ("lamps", ("lamp*",)), ("sky", ("environment",)),
    ]  # fmt: skip
    position, normal = points(2000)
    for name in ("base", "lamps", "sky"):
        alone = {group.name: float(group.name == name) for group in made.groups}
        before, after = (gsgi.sample(one, position, normal, alone) for one in (made, read))
        error = np.sqrt(np.square(after - before).mean() / np.square(before).mean())
        assert error < 0.08, (name, error)  # light to 5 %, eight further coefficients to 1/12 of it
        assert before.any()
    assert not read.groups[1].coarse_sh.any()


def test_constant_light_is_within_half_a_step():
    read, step = codec.decode(codec.encode(bake())), 2 ** (0.5 / GROUP_STEPS["light_steps"])
    for before, after in zip(bake().groups, read.groups, strict=True):
        for given, found in ((before.sh, after.sh), (before.coarse_sh, after.coarse_sh)):
            given, found = (np.sort(array[:, 0].ravel())[len(array) // 10 :] for array in (given, found))  # no darkness
            ratio = found / given
            assert step**-1.001 <= ratio.min() <= ratio.max() <= step**1.001
        assert abs(after.slope).max() <= 0.3 + 0.51 / GROUP_STEPS["slope_steps"]


def test_further_bands_are_within_half_a_step_of_their_own_channel():
    read, half = codec.decode(codec.encode(bake())), 0.5 / GROUP_STEPS["sh_steps"]
    for before, after in zip(bake().groups, read.groups, strict=True):
        lit = (after.coarse_sh[:, 0] > 0).all(axis=1)
        given, found = (light.coarse_sh[lit, 1:].astype(float) for light in (before, after))
        unit = after.coarse_sh[lit, :1].astype(float)
        assert abs((found - given) / unit)[:, :3].max() <= 1.001 * half
        assert np.ptp(found[:, 3:] / unit, axis=2).max() < 1e-6
        assert abs(((found - given) * unit)[:, 3:].sum(axis=2) / np.square(unit).sum(axis=2)).max() <= 1.001 * half


def test_a_tint_that_is_the_same_everywhere_takes_no_bytes():
    sizes = []
    for tint in ((1, 1, 1), (0.5, 1, 0.25), (0, 1, 0)):
        groups = [
            replace(one, sh=one.sh[..., 1:2] * np.float32(tint), coarse_sh=one.coarse_sh[..., 1:2] * np.float32(tint))
            for one in bake().groups
        ]
        data = codec.encode(replace(bake(), groups=tuple(groups)))
        sizes.append(len(data))
        assert all(one.coarse_sh[..., 0].any() == (tint[0] > 0) for one in codec.decode(data).groups)
    assert sizes[1] < sizes[0] + 10


def test_the_levels_are_those_of_the_file_without_groups():
    data = codec.encode(bake())
    without = codec.encode(replace(bake(), groups=()))
    assert data[12 : len(without)] == without[12:]  # all but the checksum
    read = codec.decode(data)
    for level in ("gaussians", "coarse"):
        for name, array in vars(getattr(codec.decode(without), level)).items():
            np.testing.assert_array_equal(getattr(getattr(read, level), name), array)


def test_what_is_read_is_written_as_it_was():
    data = codec.encode(bake())
    assert codec.encode(codec.decode(data)) == data


def test_the_order_of_gaussians_does_not_count():
    made, order = bake(), np.random.default_rng(2).permutation(len(FINE))
    mixed = replace(made.gaussians, **{name: array[order] for name, array in vars(made.gaussians).items()})
    groups = tuple(replace(group, sh=group.sh[order], slope=group.slope[order]) for group in made.groups)
    assert codec.encode(replace(made, gaussians=mixed, groups=groups)) == codec.encode(made)


def test_a_group_of_no_gaussians():
    empty = surface_example(0, 0)
    read = codec.decode(codec.encode(grouped(empty)))
    assert [len(group.sh) for group in read.groups] == [0, 0, 0]


@pytest.mark.parametrize("field", GROUP.names[:3])
def test_steps_are_at_least_one(field):
    broken = content()
    broken[GROUP.names.index(field)] = 0
    assert f"(group.{field}): expected at least 1" in refused(with_group(broken))


def test_groups_that_no_encoder_writes_are_refused():
    good, head = bytes(content()), GROUP.itemsize
    assert codec.decode(with_group(good)).groups[0].patterns == ("a*", "ü")
    first = len(codec.encode(surface_example())) + 8
    assert refused(with_group(good[:4])) == f"byte {first} (group): expected {head} bytes"
    assert refused(with_group(good[: head + 2])) == f"byte {first + head} (group.name): expected 5 bytes"
    assert refused(with_group(good + b"\0")).endswith("(group): expected the end of the section")
    assert "(group.coarse.green)" in refused(with_group(good[:-40])) or "group.coarse" in refused(
        with_group(good[:-40])
    )
    assert "(group.name): expected UTF-8" in refused(with_group(good[:head] + b"\xff" + good[head + 1 :]))
    assert "(group.name): expected a name that can be printed" in refused(
        with_group(good[:head] + b"\n" + good[head + 1 :])
    )
    assert codec.decode(with_group(content(name="\u200b\U0001fae9"))).groups[0].name == "\u200b\U0001fae9"
    assert "(group.pattern_count): expected patterns" in refused(with_group(content(patterns=())))
    assert "(group.pattern_count): expected patterns" in refused(with_group(content(name="base")))
    at = head + 5
    longer = good[:at] + (60_000).to_bytes(2, "little") + good[at + 2 :]
    assert "(group.pattern): expected 60000 bytes" in refused(with_group(longer))
    twice = reseal(with_group(good) + section(GROUP_TAG, good))
    assert "(group.name): expected another name than 'lamps', which is taken" in refused(twice)
    many = b"".join(section(GROUP_TAG, bytes(content(name=f"{i}"))) for i in range(3))
    assert len(codec.decode(reseal(codec.encode(surface_example()) + many)).groups) == 3


def test_only_surface_has_groups():
    over = codec.encode(example())
    data = reseal(over + section(GROUP_TAG, bytes(content())))
    assert refused(data) == f"byte {len(over)} (section): expected no b'GRUP', since over has none"


@pytest.mark.parametrize("seed", range(30))
def test_damage_is_refused_or_read(seed):
    """A byte of a group is another: the file is refused, or what is read is finite."""
    good, rng = content(), np.random.default_rng(seed)
    good[rng.integers(len(good))] = rng.integers(256)
    try:
        read = codec.decode(with_group(good))
    except FormatError:
        return
    for group in read.groups:
        assert all(np.isfinite(array).all() for array in (group.sh, group.slope, group.coarse_sh))


def test_a_file_without_groups_has_no_byte_of_them():
    data = codec.encode(surface_example())
    assert GROUP_TAG not in data
    assert len(data) > HEADER.itemsize
