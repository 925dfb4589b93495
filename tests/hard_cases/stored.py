"""Bakes written to a .gsgi file and read again."""

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np
from quantisation import errors

from gsgi.runtime.file import codec
from gsgi.runtime.file.header import HEADER
from gsgi.runtime.gaussians import Bake

from .build import NAMES
from .case import Case, Tolerance

TOLERANCE = Tolerance(1.001, "the worst that the format allows, and float32's rounding of what is read")


@dataclass(frozen=True)
class StoredBake:
    """A bake that is written and read."""

    bake: Bake

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The largest error of an attribute, in parts of the worst that the format allows."""
        return stored_error(self.bake)


def stored_error(bake: Bake) -> float:
    """The largest error of what is read, in parts of the worst. What is read is written as it was."""
    data = codec.encode(bake)
    once = codec.decode(data)
    header = np.frombuffer(data, HEADER, 1)[0]
    surface = bake.coarse is not None
    levels = [(bake.gaussians, once.gaussians, header["fine"], surface)]
    levels += [(bake.coarse, once.coarse, header["coarse"], False)] if surface else []
    found = [0.0]
    for before, after, level, facing in levels:
        assert all(np.isfinite(getattr(after, name)).all() for name in NAMES)
        found += errors(before, after, level, facing).values()
    assert codec.encode(once) == data
    return max(found)


def stored_case(
    name: str, build, holds: str = "what is read is within the format's errors, and is written as it was read",
    refused: tuple[type[Exception], str] | None = None, tolerances: Mapping[str, Tolerance] | None = None,
) -> Case:  # fmt: skip
    """A case of the file of the bake that `build()` returns."""
    return Case("Codec", name, holds, lambda: StoredBake(build()), tolerances or {"file": TOLERANCE}, refused)
