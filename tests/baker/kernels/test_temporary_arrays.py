"""Arrays that only the kernels hold: they live until the call is over."""

import weakref

import numpy as np
import oracle
import scenes
from surface_cases import field_of, gaussians, points

from gsgi.baker.native import kernels
from gsgi.baker.over.raw_gaussians import RawGaussians
from gsgi.baker.over.workspace import AdamState
from gsgi.runtime.gaussians import OverBlend

PINHOLE = scenes.inside_camera().pinhole(32, 32)


class Temporary:
    """A record that makes each array anew when it is read, and overwrites it as soon as nobody holds it."""

    def __init__(self, record):
        self._record, self._memory = record, []

    def __getattr__(self, name: str):
        value = getattr(self._record, name)
        if not isinstance(value, np.ndarray):
            return Temporary(value)
        self._memory.append(value.copy())
        array = self._memory[-1].view()
        weakref.finalize(array, self._memory[-1].fill, 99)
        return array


def test_arrays_at_surface_points():
    position, normal = points(500)
    given = gaussians(60)
    temporary, field = Temporary(given), field_of(given, position, normal)
    light = field.read(given)
    np.testing.assert_array_equal(field.read(temporary), light)
    inverse = np.ones(len(position), np.float32)
    values = np.ascontiguousarray(light[:, :3])
    for one, other in (
        (
            field.backward(temporary, values, values, inverse),
            field.backward(given, values, values, inverse),
        ),
        (field.transposed(temporary, values, inverse), field.transposed(given, values, inverse)),
    ):
        np.testing.assert_array_equal(one, other)
    listed = field.entry_count
    field.list(temporary, 0.05, 2, 1.0)
    assert field.entry_count == listed


def test_arrays_in_training():
    raw = RawGaussians.from_gaussians(oracle.random_gaussians(60, 1, seed=0))
    by_image, found = np.ones((32, 32, 3), np.float32), []
    for read in (lambda record: record, Temporary):
        workspace = kernels.Workspace()
        drawn = workspace.forward(read(raw), PINHOLE, OverBlend(0.01))
        found.append([*drawn, *workspace.step(read(raw), read(AdamState.zeros(raw)), by_image, [0.0] * 5, None)])
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    assert found[0][2].any()
