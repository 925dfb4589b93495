"""Damaged and hostile .gsgi files, and what the encoder refuses to write."""

import re
from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import ARRAYS, STORED, changed, example, gaussians, reseal, stored, surface_example

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import GAUSSIAN_COUNT_MAX, LEVELS
from gsgi.runtime.file.levels import LEVEL
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


EITHER = [
    *[("reserved", 1), ("operator", 2), ("effects", 0x200), ("effects", 0x8000)],
    *[("version", 0), ("version", 1), ("version", 3), ("version", 5), ("header_bytes", 88), ("header_bytes", 146)],
    *[("tone_scale", 0), ("tone_scale", np.nan)],
    *[(f"{level}.gaussian_count", 2**31) for level in LEVELS],
    *[(f"{level}.{field}", np.nan) for level in LEVELS for field in LEVEL.names if LEVEL[field].base.kind == "f"],
    *[(f"{level}.position_step", value) for level in LEVELS for value in (3e38, -1, np.inf)],
    *[(f"{level}.log_scale_min", value) for level in LEVELS for value in (60, -60)],
    *[(f"{level}.log_scale_step", value) for level in LEVELS for value in (-1, 1, 1e38)],
    *[(f"{level}.sh_rest_step", value) for level in LEVELS for value in (-1, 2e30)],
]
OVER = [
    *[("near", np.nan), ("near", -1), ("dilation", np.inf), ("alpha_min", 0), ("alpha_max", 1), ("alpha_max", 0.001)],
    *[("operator", 1), ("sharpness", 1), ("cutoff", 0.05), ("floor", 0.1), ("fine.sh_degree", 4), ("fine.basis", 1)],
    *[("coarse.sh_degree", 1), ("coarse.position_min", 1), ("coarse.position_step", 1), ("coarse.log_scale_min", 1)],
    *[("coarse.basis", 1), ("coarse.gaussian_count", 1), ("coarse.sh_rest_step", 1)],
]
SURFACE = [
    *[("cutoff", value) for value in (0, 1, -0.1, 2, np.nan)],
    *[("floor", value) for value in (0, 1.1e6, -0.1, np.inf, np.nan)],
    *[("sharpness", value) for value in (0, 65, 255)],
    *[("operator", 0), ("near", 0.1), ("dilation", 0.1), ("alpha_min", 0.1), ("alpha_max", 0.1), ("near", np.nan)],
    *[("fine.sh_degree", 1), ("fine.sh_degree", 4), ("coarse.sh_degree", 3), ("coarse.sh_degree", 1)],
    *[("fine.basis", 0), ("coarse.basis", 1), ("fine.basis", 2), ("coarse.basis", 2), ("fine.basis", 0xFFFF)],
    *[("fine.gaussian_count", 1), ("coarse.gaussian_count", 3), ("coarse.gaussian_count", GAUSSIAN_COUNT_MAX - 1)],
]


@pytest.mark.parametrize(
    ("bake", "field", "value"),
    [(example(2), *case) for case in EITHER + OVER]
    + [(surface_example(2, 0, 2, 2), *case) for case in EITHER + SURFACE],
)
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


@pytest.mark.parametrize("name", STORED)
def test_whatever_the_numbers_say_what_is_decoded_is_usable(name):
    """Random bytes at random places behind the checksum: refused, or decoded to what the renderer can take."""
    rng, data = np.random.default_rng(11), bytearray(stored(name))
    decoded = 0
    for _ in range(1500):
        damaged = data.copy()
        for at in rng.integers(12, len(data), rng.integers(1, 4)):
            damaged[at] = rng.integers(256)
        try:
            bake = codec.decode(reseal(bytes(damaged)))
        except FormatError:
            continue
        decoded += 1
        assert (bake.coarse is not None) == isinstance(bake.blend, SurfaceBlend)
        for level in filter(None, (bake.gaussians, bake.coarse)):
            assert all(np.isfinite(getattr(level, field)).all() for field in ARRAYS)
            assert (level.scale > 0).all()
            assert level.sh[:, 0].min() >= 0
            np.testing.assert_allclose(np.linalg.norm(level.rotation, axis=1), 1, rtol=1e-5)
    assert 100 < decoded < 1400


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
