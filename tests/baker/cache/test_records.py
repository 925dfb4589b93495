"""Records as flat dicts of arrays: there and back."""

from dataclasses import dataclass

import numpy as np

from gsgi.baker.cache.records import from_arrays, to_arrays


@dataclass(frozen=True)
class Inner:
    a: np.ndarray
    count: int


@dataclass(frozen=True)
class Outer:
    inner: Inner
    b: np.ndarray
    scale: float


def test_a_record_in_a_record_comes_back():
    record = Outer(Inner(np.arange(3), 5), np.eye(2, dtype=np.float32), 0.25)
    arrays = to_arrays(record)
    assert list(arrays) == ["inner.a", "inner.count", "b", "scale"]
    back = from_arrays(Outer, arrays)
    assert (back.inner.count, type(back.inner.count), back.scale, type(back.scale)) == (5, int, 0.25, float)
    np.testing.assert_array_equal(back.inner.a, record.inner.a)
    np.testing.assert_array_equal(back.b, record.b)
