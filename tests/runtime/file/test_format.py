"""FORMAT.md states what the codec does."""

import re
from pathlib import Path

import numpy as np
import pytest
from gsgi_files import example, surface_example

from gsgi.runtime.constants import SH_C0
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import EFFECT_BITS, HEADER, OPERATOR_NAMES, OPERATORS, VERSION
from gsgi.runtime.file.levels import LEVEL, SLOPE_STEP, planes
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
    stated = re.search(r"^\| \d+ \| u2 \| basis \| (.*) \|$", FORMAT, re.MULTILINE)[1]
    for number, basis in enumerate(BASES):
        assert f"{number} = {basis}" in stated
    assert f"code / {1 / SLOPE_STEP:g}" in FORMAT


def test_format_md_shows_a_whole_file():
    """The example in hex is what the encoder writes, and its table says what the bytes mean."""
    section = FORMAT.split("## A whole file")[1].split("## ")[0]
    lines = re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} ?)+)", section, re.MULTILINE)
    data = b"".join(bytes.fromhex(line) for _, line in lines)
    assert [int(offset, 16) for offset, _ in lines] == list(range(0, len(data), 16))
    bake = codec.decode(data)
    assert codec.encode(bake) == data
    assert (len(bake.gaussians), len(bake.coarse)) == (1, 1)
    np.testing.assert_allclose(bake.gaussians.position, [[0.5, 0, -0.5]])
    np.testing.assert_allclose(bake.gaussians.scale, [[0.1, 0.1, 0.1]], rtol=1e-6)
    np.testing.assert_allclose(bake.gaussians.sh[0, 0] * SH_C0, [0.5, 0.25, 0.125])
    np.testing.assert_allclose(bake.gaussians.rotation, [[0, 0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(bake.gaussians.opacity, [1.0])
    np.testing.assert_array_equal(bake.gaussians.slope, [[0.25, -0.125]])
    assert not bake.coarse.sloped


def test_format_md_states_the_arrays_in_order_and_the_size():
    section = FORMAT.split("## Arrays")[1].split("**rotation**")[0]
    names = [name for _, name in re.findall(r"^\| ([iu]\d[^|]*) \| (\w+) \|", section, re.MULTILINE)]
    assert names == list(planes(1, 1, BASES.index("linear")).names)
    fixed, rest, slope = map(int, re.search(r"N \* \((\d+) \+ (\d+) \* \(K - 1\) \+ (\d+) \* basis\)", FORMAT).groups())
    header = int(re.search(r"a file has (\d+) bytes more than its two levels", FORMAT)[1])
    for degree in range(4):
        level = 5 * (fixed + rest * ((degree + 1) ** 2 - 1))
        assert len(codec.encode(example(5, degree))) == header + level
    assert len(codec.encode(surface_example(5, 2, 7, 0))) == header + 5 * (fixed + 8 * rest + slope) + 7 * fixed
