"""Damaged and hostile .gsgi files, and what the encoder refuses to write."""

import re
from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import (
    NONSENSE,
    STORED,
    changed,
    example,
    gaussians,
    reseal,
    stored,
    surface_example,
)
from surface_cases import with_coarse_slopes

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec, levels
from gsgi.runtime.file.header import GAUSSIAN_COUNT_MAX, HEADER, LEVELS, section
from gsgi.runtime.gaussians import OverBlend, SurfaceBlend


@pytest.mark.parametrize("name", STORED)
def test_every_prefix_is_refused(name):
    data = stored(name)
    for length in range(len(data)):
        with pytest.raises(FormatError, match="byte"):
            codec.decode(data[:length])
    with pytest.raises(FormatError, match="byte"):
        codec.decode(data + b"\0")


@pytest.mark.parametrize("name", STORED)
def test_every_damaged_byte_is_noticed(name):
    data = stored(name)
    for i in range(len(data)):
        with pytest.raises(FormatError):
            codec.decode(data[:i] + bytes([data[i] ^ 0x55]) + data[i + 1 :])


@pytest.mark.parametrize(("bake", "field", "value"), NONSENSE)
def test_resealed_nonsense_is_refused(bake, field, value):
    data = codec.encode(bake)
    assert codec.decode(reseal(data))
    with pytest.raises(FormatError, match="expected"):
        codec.decode(changed(data, field, value))


@pytest.mark.parametrize("level", LEVELS)
def test_surface_has_no_sh_of_degree_3(level):
    bake = surface_example(2, 3, 2, 2) if level == "fine" else surface_example(2, 0, 2, 3)
    with pytest.raises(AssertionError, match=f"{level}.sh_degree"):
        codec.encode(bake)
    data = changed(codec.encode(surface_example(0, 0, 0, 0)), f"{level}.sh_degree", 3)
    with pytest.raises(FormatError, match=rf"{level}\.sh_degree\): expected 0 to 2, got 3"):
        codec.decode(data)


def test_coarse_gaussians_have_no_slopes():
    """A group has no coarse ones, for which the reader in C keeps no room."""
    with pytest.raises(AssertionError, match=r"coarse\.basis"):
        codec.encode(replace(surface_example(), coarse=gaussians(4, 2, sloped=True)))
    with pytest.raises(FormatError, match=r"coarse\.basis\): expected 0, since only fine Gaussians have slopes, got 1"):
        codec.decode(with_coarse_slopes())


@pytest.mark.parametrize("level", LEVELS)
def test_an_unknown_basis_is_named(level):
    data = changed(codec.encode(surface_example(2, 0, 2, 2)), f"{level}.basis", 2)
    with pytest.raises(FormatError, match=rf"{level}\.basis\): expected 0 \(constant\) or 1 \(linear\), got 2"):
        codec.decode(data)


@pytest.mark.parametrize(
    ("name", "field", "place"),
    [
        ("v6_over", "near", "byte 32 (near)"),
        ("v6_surface", "floor", "byte 52 (floor)"),
    ],
)
def test_an_error_names_the_place_in_the_file_itself(name, field, place):
    with pytest.raises(FormatError, match=re.escape(place)):
        codec.decode(changed(stored(name), field, -1))


def test_the_manifest_of_a_world_is_told_from_light():
    manifest = b'{"format": "gsgi-world"}'.ljust(200)
    with pytest.raises(FormatError, match=r"\(magic\): expected b'GSGI', got .*: is it the manifest of a world"):
        codec.decode(manifest)


@pytest.mark.parametrize(
    "change",
    [
        *[{"bounces": -1}, {"bounces": 1 << 16}, {"scene": 1 << 64}, {"effects": 0x400}, {"tone_scale": 0.0}],
        *[{"blend": OverBlend(near=-1)}, {"blend": OverBlend(near=0.1, alpha_max=1.0)}],
        *[{"blend": SurfaceBlend()}, {"coarse": gaussians(1, 0)}, {"coarse": gaussians(0, 0)}],
        *[
            {"coarse": gaussians(1, 0), "blend": blend}
            for blend in (SurfaceBlend(cutoff=0.0), SurfaceBlend(cutoff=1.0))
        ],
        *[{"coarse": gaussians(1, 0), "blend": SurfaceBlend(sharpness=sharpness)} for sharpness in (0, 65, 4.5)],
        *[{"coarse": gaussians(1, 0), "blend": SurfaceBlend(floor=floor)} for floor in (0.0, 1.1e6)],
    ],
)
def test_what_a_reader_would_refuse_is_not_written(change):
    with pytest.raises(AssertionError):
        codec.encode(replace(example(1), **change))


@pytest.mark.parametrize(("level", "byte"), [("fine", 92), ("coarse", 139)])
def test_a_hostile_count_allocates_nothing(level, byte):
    data = changed(codec.encode(surface_example(0, 0, 0, 0)), f"{level}.gaussian_count", GAUSSIAN_COUNT_MAX)
    streams, slopes = 12, 2 if level == "fine" else 0
    least = 3 * (streams + slopes // 2) + (streams + slopes) * GAUSSIAN_COUNT_MAX // 8
    with pytest.raises(FormatError, match=rf"byte {byte} \({level}\): expected at least {least} bytes"):
        codec.decode(data)


def refused(data: bytes) -> str:
    """What the reader says of a file that is sealed but wrong."""
    with pytest.raises(FormatError) as error:
        codec.decode(reseal(data))
    return str(error.value)


def test_sections_must_be_whole_and_in_order():
    data, whole = stored("v6_surface"), HEADER.itemsize
    size = int.from_bytes(data[whole + 4 : whole + 8], "little")
    fine, coarse = data[whole : whole + 8 + size], data[whole + 8 + size :]
    head = data[:whole]
    assert refused(head + coarse + fine).startswith(f"byte {whole} (fine): expected b'FINE'")
    assert refused(head + fine).startswith(f"byte {len(head + fine)} (coarse): expected a section")
    assert refused(head + fine + coarse + fine).startswith(f"byte {len(data)} (section): expected no second b'FINE'")
    assert refused(data + b"GRPS").startswith(f"byte {len(data) + 4} (section): expected a section")
    assert refused(data + b"GRPS" + bytes([9, 0, 0, 0])).startswith(f"byte {len(data) + 8} (section): expected 9 bytes")
    longer = head + section(b"FINE", fine[8:] + b"\0") + coarse
    assert refused(longer) == f"byte {len(head + fine)} (fine): expected the end of the section"
    shorter = head + section(b"FINE", fine[8:-1]) + coarse
    assert re.fullmatch(r"byte \d+ \(fine\.slope\): expected \d bytes of bits", refused(shorter))


@pytest.mark.parametrize(
    ("stream", "value", "expected"),
    [
        ("scale_long", 57 * 40, "scales within"),
        ("scale_middle", -1, "a second axis no longer than the first"),
        ("normal_u", 97, "steps from -96 to 96"),
        ("position_x", 1 << 24, "steps from -16777215 to 16777215"),
        ("opacity", 25, "steps from 0 to 24"),
        ("green", -1, "steps from 0 to 1536"),
        ("blue", -2000, "steps from 0 to 1536"),
        ("slope", 128, "steps from -127 to 127"),
    ],
)
def test_codes_beyond_their_range_are_refused(monkeypatch, stream, value, expected):
    part = "_light" if stream in levels.light_counts(np.ones((), levels.LEVEL)) else "_shape"
    write = getattr(levels, part)

    def spoilt(*arguments):
        values = write(*arguments)
        return values | {name: np.full_like(old, value) for name, old in values.items() if name == stream}

    monkeypatch.setattr(levels, part, spoilt)
    with pytest.raises(FormatError, match=rf"byte \d+ \(fine\.{stream}\): expected {expected}"):
        codec.decode(codec.encode(surface_example(5, 0, 2, 2)))


def test_the_limit_on_gaussians_is_one_of_both_levels():
    data = changed(codec.encode(surface_example(0, 0, 0, 0)), "fine.gaussian_count", GAUSSIAN_COUNT_MAX)
    with pytest.raises(FormatError, match=f"coarse.gaussian_count.*at most {GAUSSIAN_COUNT_MAX}"):
        codec.decode(changed(data, "coarse.gaussian_count", 1))
