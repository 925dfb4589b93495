"""Streams of integers as bits: Golomb's codes and exponential ones, which a reader needs no tables for.

A stream is a byte of flags, two varints and two runs of bits; FORMAT.md specifies it. Golomb 1966, "Run-Length
Encodings"; Rice 1979; exponential: Teuhola 1978. The unary parts of all numbers stand together, and so do their other
bits, so that all numbers of a stream can be read at once.
"""

from collections.abc import Callable

import numpy as np

SHIFT_BITS, EXPONENTIAL, DELTA = 0x1F, 0x20, 0x40
SHIFT_MAX = 24
MAGNITUDE_MAX = 1 << 26  # of a number and of the base; a difference has at most twice as much
FOLDED_BITS = 28  # of a difference, folded

AT_ONCE = 1 << 16  # numbers whose bits are spread out together

# expect(condition, byte, expected): raises if the condition is false
Expect = Callable[[bool, int, str], None]


def write_integers(values: np.ndarray, delta: bool = True) -> bytes:
    """The stream of integers (N,) in whichever coding takes the fewest bytes; `delta` allows differences.

    No magnitude may exceed MAGNITUDE_MAX.
    """
    values = np.asarray(values, np.int64).ravel()
    assert np.abs(values).max(initial=0) <= MAGNITUDE_MAX, np.abs(values).max()
    middle = int(np.sort(values)[len(values) // 2]) if len(values) else 0
    streams = [_write(values - middle, middle, 0)]
    if delta and len(values):
        streams.append(_write(np.diff(values, prepend=values[0]), int(values[0]), DELTA))
    return min(streams, key=len)


def read_integers(data: bytes, at: int, end: int, count: int, expect: Expect) -> tuple[np.ndarray, int]:
    """The `count` integers (N,) int64 of the stream at byte `at`, and the byte after it, which is at most `end`."""
    start = at
    expect(at < end, at, "a stream")
    flags = data[at]
    shift = flags & SHIFT_BITS
    expect(shift <= SHIFT_MAX and flags < 0x80, at, f"flags below 0x80 with a shift of 0 to {SHIFT_MAX}")
    base, at = _read_varint(data, at + 1, end, expect)
    unary_bytes, at = _read_varint(data, at, end, expect)
    expect(unary_bytes <= end - at, at, f"{unary_bytes} bytes of unary codes")
    bits = np.unpackbits(np.frombuffer(data, np.uint8, unary_bytes, at), bitorder="little")
    ones = np.flatnonzero(bits)
    last = int(ones[-1]) if len(ones) else -1
    expect(
        len(ones) == count and last // 8 + 1 == unary_bytes,
        at,
        f"unary codes of {count} numbers, and zeros to the byte's end",
    )
    at += unary_bytes
    prefix = np.diff(ones, prepend=-1) - 1
    exponential = bool(flags & EXPONENTIAL)
    low = prefix + shift if exponential else np.full(count, shift)
    fits = prefix.max(initial=0) <= (FOLDED_BITS - shift if exponential else 1 << FOLDED_BITS - shift)
    expect(fits, start, f"numbers of at most {MAGNITUDE_MAX}")
    rest, at = read_bits(data, at, end, low, expect)
    high = (1 << prefix) - 1 if exponential else prefix
    folded = (high << shift) + rest
    numbers = folded >> 1 ^ -(folded & 1)
    base = base >> 1 ^ -(base & 1)
    values = np.cumsum(numbers) + base if flags & DELTA else numbers + base
    expect(np.abs(values).max(initial=0) <= MAGNITUDE_MAX, start, f"numbers of at most {MAGNITUDE_MAX}")
    return values, at


def write_bits(values: np.ndarray, widths: np.ndarray) -> bytes:
    """The lowest `widths` (N,) bits, at most 31 each, of integers (N,), lowest bit first, and zeros to a whole byte."""
    place = np.arange(int(widths.max(initial=0)))
    parts = [np.zeros(0, np.uint8)]
    for first in range(0, len(values), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        bits = (values[part, None] >> place & 1).astype(np.uint8)
        parts.append(bits[place < widths[part, None]])
    return np.packbits(np.concatenate(parts), bitorder="little").tobytes()


def read_bits(data: bytes, at: int, end: int, widths: np.ndarray, expect: Expect) -> tuple[np.ndarray, int]:
    """The integers (N,) int64 that `write_bits` wrote at byte `at`, and the byte after them."""
    after = np.cumsum(widths)
    total = int(after[-1]) if len(after) else 0
    size = (total + 7) // 8
    expect(size <= end - at, at, f"{size} bytes of bits")
    padded = np.frombuffer(data[at : at + size] + bytes(8), np.uint8)
    expect(total % 8 == 0 or padded[size - 1] >> total % 8 == 0, at + size - 1, "zeros to the byte's end")
    windows = np.ndarray((size + 1,), "<u8", padded.data, strides=(1,))  # one at each byte
    first = after - widths
    found = windows[first >> 3] >> (first & 7).astype(np.uint64)
    return (found & (np.uint64(1) << widths.astype(np.uint64)) - np.uint64(1)).astype(np.int64), at + size


def least_bytes(count: int) -> int:
    """A stream of `count` numbers takes at least so many bytes."""
    return 3 + (count + 7) // 8


def _write(numbers: np.ndarray, base: int, flags: int) -> bytes:
    folded = np.where(numbers < 0, -2 * numbers - 1, 2 * numbers)
    shift, exponential = _cheapest(folded)
    if exponential:
        prefix = np.frexp(((folded >> shift) + 1).astype(float))[1] - 1
        low, rest = prefix + shift, folded - (((1 << prefix.astype(np.int64)) - 1) << shift)
    else:
        prefix, low, rest = folded >> shift, np.full(len(folded), shift), folded & (1 << shift) - 1
    unary = np.zeros(int(prefix.sum()) + len(prefix), np.uint8)
    unary[np.cumsum(prefix + 1) - 1] = 1
    unary = np.packbits(unary, bitorder="little").tobytes()
    base = -2 * base - 1 if base < 0 else 2 * base
    head = bytes([flags | shift | (EXPONENTIAL if exponential else 0)]) + _varint(base) + _varint(len(unary))
    return head + unary + write_bits(rest, low)


def _cheapest(folded: np.ndarray) -> tuple[int, bool]:
    """The shift, and whether the exponential code, that takes the fewest bits for numbers (N,) of 0 or more."""
    sizes = {}
    for shift in range(SHIFT_MAX + 1):
        high = folded >> shift
        sizes[shift, False] = int(high.sum()) + len(folded) * (1 + shift)
        length = np.frexp((high + 1).astype(float))[1] - 1
        sizes[shift, True] = int(2 * length.sum()) + len(folded) * (1 + shift)
    return min(sizes, key=sizes.get)


def _varint(number: int) -> bytes:
    """LEB128: seven bits a byte, lowest first; the top bit says that more follow."""
    parts = []
    while number > 0x7F:
        parts.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*parts, number])


def _read_varint(data: bytes, at: int, end: int, expect: Expect) -> tuple[int, int]:
    number = shift = 0
    while True:
        expect(at < end and shift < 28, at, "a varint of at most four bytes")
        byte = data[at]
        number |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            break
    return number, at
