"""Relief in a .gsgi file: how light follows normal maps."""

from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import example, reseal, surface_example
from quantisation import in_stored_order
from surface_cases import with_relief

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import HEADER, RELIEF_TAG, section
from gsgi.runtime.file.relief import RELIEF_STEPS
from gsgi.runtime.gaussians import Bake, Gaussians, LightGroup
from gsgi.runtime.light_groups import weighted


def bumpy() -> Bake:
    return with_relief(surface_example(40))


def relief_section(data: bytes) -> tuple[int, int]:
    """Where the section of relief begins in a file, and where it ends."""
    at = data.index(RELIEF_TAG)
    return at, at + 8 + int.from_bytes(data[at + 4 : at + 8], "little")


def test_relief_is_within_half_a_step_of_the_brightest_channel():
    bake = bumpy()
    data = codec.encode(bake)
    decoded = codec.decode(data).gaussians
    given = in_stored_order(bake.gaussians, np.frombuffer(data, HEADER, 1)[0]["fine"], True)
    brightest = SH_C0 * decoded.sh[:, 0].max(axis=1)[:, None, None]
    assert decoded.relief.any()
    assert (np.abs(decoded.relief - given.relief) <= 0.501 / RELIEF_STEPS * brightest).all()


def test_what_is_read_is_written_as_it_was():
    data = codec.encode(bumpy())
    assert codec.encode(codec.decode(data)) == data


def test_without_relief_the_file_is_as_before_and_with_it_the_levels_are():
    bake = bumpy()
    flat = replace(bake, gaussians=replace(bake.gaussians, relief=None))
    data, plain = codec.encode(bake), codec.encode(flat)
    begin, end = relief_section(data)
    assert reseal(data[:begin] + data[end:]) == plain
    assert not codec.decode(plain).gaussians.bumpy


def test_no_gaussian_and_black_ones_have_relief_too():
    none = replace(bumpy(), gaussians=Gaussians(*(array[:0] for array in vars(bumpy().gaussians).values())))
    assert codec.decode(codec.encode(none)).gaussians.bumpy
    black = bumpy()
    black.gaussians.sh[:] = 0
    assert not codec.decode(codec.encode(black)).gaussians.relief.any()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (lambda c: b"\0" + c[1:], "relief.relief_steps"),
        (lambda c: c[:20], "relief"),
        (lambda c: c + b"\0", "relief): expected the end of the section"),
    ],
)
def test_damaged_relief_is_refused(content, message):
    data = codec.encode(bumpy())
    begin, end = relief_section(data)
    broken = data[:begin] + section(RELIEF_TAG, content(data[begin + 8 : end])) + data[end:]
    with pytest.raises(FormatError, match=message.replace("(", r"\(").replace(")", r"\)")):
        codec.decode(reseal(broken))


def test_codes_beyond_their_range_and_a_second_section_are_refused():
    data = codec.encode(bumpy())
    begin, end = relief_section(data)
    with pytest.raises(FormatError, match="expected no second"):
        codec.decode(reseal(data + data[begin:end]))
    with pytest.raises(FormatError, match="since over has none"):
        codec.decode(reseal(codec.encode(example()) + data[begin:end]))


def test_relief_follows_the_weights_of_light_groups():
    bake = bumpy()
    fine, coarse = np.maximum(bake.gaussians.sh, 0), bake.coarse.sh
    bake = replace(bake, gaussians=replace(bake.gaussians, sh=fine))
    share = np.float32([0.25, 0.5, 0.75])
    parts = {"lamps": share, "base": 1 - share}
    groups = tuple(
        LightGroup(name, ("a",) if name != "base" else (), part * fine, bake.gaussians.slope, part * coarse)
        for name, part in parts.items()
    )
    off = weighted(replace(bake, groups=groups), {"base": 0.0}).gaussians
    lit = (fine[:, :1] > 0) & np.ones_like(bake.gaussians.relief, bool)
    np.testing.assert_allclose(off.relief[lit], (share * bake.gaussians.relief)[lit], rtol=1e-5)
