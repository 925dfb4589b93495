"""FORMAT.md states what the codec does."""

import re
from pathlib import Path

import numpy as np
import pytest

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import EFFECT_BITS, HEADER, OPERATOR_NAMES, OPERATORS, VERSION
from gsgi.runtime.file.integers import FOLDED_BITS, MAGNITUDE_MAX, SHIFT_MAX, least_bytes
from gsgi.runtime.file.levels import LEVEL, stream_counts
from gsgi.runtime.gaussians import BASES, Effects

FORMAT = Path(codec.__file__).with_name("FORMAT.md").read_text(encoding="utf-8")


def stated_fields(section: str) -> list[tuple[int, str, str]]:
    """Rows `| offset | type | field |` of a part of FORMAT.md."""
    rows = re.findall(r"^\| (\d+) \| (\S+(?: x \d)?) \| (\w+) \|", section, re.MULTILINE)
    return [(int(offset), kind, name) for offset, kind, name in rows]


def actual_fields(layout: np.dtype) -> list[tuple[int, str, str]]:
    found = []
    for name in layout.names:
        kind, offset = layout.fields[name]
        base = "level" if kind == LEVEL else kind.base.str.lstrip("<|")
        found.append((offset, base + (f" x {kind.shape[0]}" if kind.shape else ""), name))
    return found


def test_format_md_states_the_header_that_the_codec_uses():
    header, level = FORMAT.split("## Header")[1].split("Effects:")[0].split("A level is")
    assert stated_fields(header) == actual_fields(HEADER)
    assert stated_fields(level) == actual_fields(LEVEL)
    assert level.startswith(f" {LEVEL.itemsize} bytes")
    assert f"| header_bytes | {HEADER.itemsize} |" in header
    assert f"| version | {VERSION} |" in header
    for number, operator in enumerate(OPERATORS):
        assert re.search(rf"\| operator \|.*\b{number} = `{OPERATOR_NAMES[operator]}`", header)


@pytest.mark.parametrize("layout", [HEADER, LEVEL], ids=["header", "level"])
def test_every_header_field_lies_at_a_multiple_of_its_size(layout):
    for name in layout.names:
        kind, offset = layout.fields[name]
        size = 4 if kind == LEVEL or kind.kind == "S" else kind.base.itemsize
        assert offset % size == 0, name
    assert layout.itemsize % 4 == 0


def test_format_md_states_the_effects():
    rows = re.findall(r"^\| (\d+) \| (\w+) \| ", FORMAT.split("| bit |")[1].split("\n\n")[0], re.MULTILINE)
    assert rows == [(str(effect.value), effect.name.lower()) for effect in Effects]
    assert sum(Effects) == EFFECT_BITS


def test_format_md_states_the_bases():
    stated = re.search(r"^\| \d+ \| u1 \| basis \| (.*) \|$", FORMAT, re.MULTILINE)[1]
    for number, basis in enumerate(BASES):
        assert f"{number} = {basis}" in stated


def test_format_md_shows_a_whole_file():
    """The example in hex is what the encoder writes, and its table says what the bytes mean."""
    section = FORMAT.split("## A whole file")[1].split("## ")[0]
    lines = re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} ?)+)", section, re.MULTILINE)
    data = b"".join(bytes.fromhex(line) for _, line in lines)
    assert [int(offset, 16) for offset, _ in lines] == list(range(0, len(data), 16))
    bake = codec.decode(data)
    assert codec.encode(bake) == data
    np.testing.assert_array_equal(bake.gaussians.position, [[0.5, 0, -0.5], [0.75, 0, -0.5]])
    np.testing.assert_array_equal(bake.gaussians.scale, [[0.25, 0.125, 0.0625]] * 2)
    np.testing.assert_allclose(bake.gaussians.sh[:, 0] * SH_C0, [[0.5, 0.25, 0.125], [0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(bake.gaussians.rotation, [[0, 0, 0, 1]] * 2)
    np.testing.assert_array_equal(bake.gaussians.opacity, [1, 0.5625])
    np.testing.assert_allclose(bake.gaussians.slope, [[16 / 64, -8 / 64], [0, 0]])
    np.testing.assert_array_equal(bake.coarse.scale, [[1, 1, 1]])
    assert not bake.coarse.sloped
    rows = re.findall(r"^\| ([0-9a-f]{2}) - ([0-9a-f]{2}) \|", section, re.MULTILINE)
    ends = [(int(first, 16), int(last, 16)) for first, last in rows]
    assert [first for first, _ in ends] == [0, *(last + 1 for _, last in ends[:-1])]
    assert ends[-1][1] == len(data) - 1
    assert f"one in the coarse level, {len(data)} bytes" in section


def test_format_md_states_the_streams_in_their_order():
    section = FORMAT.split("## Sections")[1].split("### ")[0]
    rows = re.findall(r"^\| (\S+) \| N(?: \* (.*?))? \|", section, re.MULTILINE)
    level = np.zeros((), LEVEL)
    level["gaussian_count"], level["sh_degree"], level["basis"] = 1, 1, BASES.index("linear")
    stated = [(name.replace("*l*", "1"), eval(factor.replace("(2 l + 1)", "3") or "1")) for name, factor in rows]
    assert [row for row in stated if row[0] != "*angle*"] == list(stream_counts(level).items())
    names = [name for name, _ in stated]
    assert names[names.index("normal_v") + 1] == "*angle*"


def test_format_md_states_the_limits_of_streams():
    assert f"at most {SHIFT_MAX}; bit 5" in FORMAT
    assert f"2^{MAGNITUDE_MAX.bit_length() - 1} in magnitude" in FORMAT
    assert f"2^({FOLDED_BITS} - shift), or {FOLDED_BITS} - shift" in FORMAT
    assert least_bytes(17) == 3 + 3
