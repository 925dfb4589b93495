"""Streams of integers: what is written is read, in few bits, and nothing else is."""

import numpy as np
import pytest

from gsgi.runtime.file.integers import (
    MAGNITUDE_MAX,
    least_bytes,
    read_bits,
    read_integers,
    write_bits,
    write_integers,
)

RNG = np.random.default_rng(5)
STREAMS = {
    "none": np.zeros(0, int),
    "one": np.array([-7]),
    "zeros": np.zeros(999, int),
    "small": RNG.integers(-3, 4, 1000),
    "large": RNG.integers(-MAGNITUDE_MAX, MAGNITUDE_MAX + 1, 1000),
    "ends": np.array([MAGNITUDE_MAX, -MAGNITUDE_MAX, 0, -MAGNITUDE_MAX, MAGNITUDE_MAX]),
    "normal": np.rint(RNG.normal(size=5000) * 20).astype(int),
    "outliers": np.where(RNG.random(5000) < 0.01, RNG.integers(-10000, 10000, 5000), RNG.integers(-4, 5, 5000)),
    "walk": RNG.integers(-5, 6, 3000).cumsum() + 100_000,
}


class RefusedError(Exception):
    """What the reader expected."""


def expect(condition: bool, byte: int, expected: str) -> None:
    if not condition:
        raise RefusedError(f"byte {byte}: expected {expected}")


@pytest.mark.parametrize("delta", [False, True])
@pytest.mark.parametrize("name", STREAMS)
def test_what_is_written_is_read(name, delta):
    values = STREAMS[name]
    stream = write_integers(values, delta)
    data = b"before" + stream + b"after"
    found, at = read_integers(data, 6, len(data), len(values), expect)
    np.testing.assert_array_equal(found, values)
    assert at == 6 + len(stream)
    assert len(stream) >= least_bytes(len(values))


def test_a_stream_takes_little_more_than_its_entropy():
    _, counts = np.unique(STREAMS["normal"], return_counts=True)
    share = counts / len(STREAMS["normal"])
    entropy = -(share * np.log2(share)).sum() * len(STREAMS["normal"]) / 8
    assert len(write_integers(STREAMS["normal"], False)) < 1.05 * entropy
    assert len(write_integers(STREAMS["walk"])) < 0.5 * len(write_integers(STREAMS["walk"], False))


def test_bits_of_any_width():
    widths = RNG.integers(0, 29, 2000)
    values = RNG.integers(0, 1 << widths)
    data = write_bits(values, widths)
    assert len(data) == -(-widths.sum() // 8)
    found, at = read_bits(data, 0, len(data), widths, expect)
    np.testing.assert_array_equal(found, values)
    assert at == len(data)


def test_every_prefix_of_a_stream_is_refused():
    for name in ("one", "small", "outliers"):
        stream = write_integers(STREAMS[name][:200])
        for end in range(len(stream)):
            with pytest.raises(RefusedError, match="byte"):
                read_integers(stream, 0, end, len(STREAMS[name][:200]), expect)


@pytest.mark.parametrize(
    ("stream", "count", "expected"),
    [
        ("", 0, "byte 0: expected a stream"),
        ("80 00 00", 0, "byte 0: expected flags"),
        ("19 00 00", 0, "byte 0: expected flags"),
        ("00 ff ff ff ff 01 00", 0, "byte 5: expected a varint"),
        ("00 00 02 01", 1, "byte 3: expected 2 bytes of unary codes"),
        ("00 00 01 03", 1, "byte 3: expected unary codes of 1 numbers"),
        ("00 00 02 01 00", 1, "byte 3: expected unary codes of 1 numbers"),
        ("00 00 01 01", 2, "byte 3: expected unary codes of 2 numbers"),
        ("04 00 01 01", 1, "byte 4: expected 1 bytes of bits"),
        ("04 00 01 01 10", 1, "byte 4: expected zeros"),
        ("18 00 04 00 00 00 80 00 00 00", 1, "byte 0: expected numbers of at most 67108864"),
        ("38 00 01 20 00 00 00 00", 1, "byte 0: expected numbers of at most 67108864"),
        ("00 fe ff ff 7f 01 01", 1, "byte 0: expected numbers of at most 67108864"),
        ("58 00 02 ff 01" + 27 * " ff", 9, "byte 0: expected numbers of at most 67108864"),
    ],
)
def test_what_no_encoder_writes_is_refused(stream, count, expected):
    data = bytes.fromhex(stream)
    with pytest.raises(RefusedError, match=expected):
        read_integers(data, 0, len(data), count, expect)


def test_too_large_numbers_are_not_written():
    with pytest.raises(AssertionError):
        write_integers(np.array([MAGNITUDE_MAX + 1]))
