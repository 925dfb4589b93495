"""Damaged and hostile .gsgi files, and what the encoder refuses to write."""

import re
from dataclasses import replace

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

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import GAUSSIAN_COUNT_MAX, LEVELS
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


@pytest.mark.parametrize("level", LEVELS)
def test_an_unknown_basis_is_named(level):
    data = changed(codec.encode(surface_example(2, 0, 2, 2)), f"{level}.basis", 2)
    with pytest.raises(FormatError, match=rf"{level}\.basis\): expected 0 \(constant\) or 1 \(linear\), got 2"):
        codec.decode(data)


@pytest.mark.parametrize(
    ("name", "field", "place"),
    [
        ("v4_over", "near", "byte 32 (near)"),
        ("v4_surface", "fine.position_step", "byte 76 (fine.position_step)"),
        ("v4_surface", "coarse.position_step", "byte 120 (coarse.position_step)"),
    ],
)
def test_an_error_names_the_place_in_the_file_itself(name, field, place):
    with pytest.raises(FormatError, match=re.escape(place)):
        codec.decode(changed(stored(name), field, -1))


@pytest.mark.parametrize(
    "change",
    [
        *[{"bounces": -1}, {"bounces": 1 << 16}, {"scene": 1 << 64}, {"effects": 0x200}, {"tone_scale": 0.0}],
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


@pytest.mark.parametrize(("level", "size"), [("fine", 20), ("coarse", 18)])
def test_a_hostile_count_allocates_nothing(level, size):
    data = changed(codec.encode(surface_example(0, 0, 0, 0)), f"{level}.gaussian_count", GAUSSIAN_COUNT_MAX)
    with pytest.raises(FormatError, match=f"expected {144 + size * GAUSSIAN_COUNT_MAX} bytes"):
        codec.decode(data)


def test_the_limit_on_gaussians_is_one_of_both_levels():
    data = changed(codec.encode(surface_example(0, 0, 0, 0)), "fine.gaussian_count", GAUSSIAN_COUNT_MAX)
    with pytest.raises(FormatError, match=f"coarse.gaussian_count.*at most {GAUSSIAN_COUNT_MAX}"):
        codec.decode(changed(data, "coarse.gaussian_count", 1))
