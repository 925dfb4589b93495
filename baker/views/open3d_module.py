"""Open3D, without the packages that it loads at once in order to draw in notebooks."""

import functools
import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gsgi.baker.interrupts import uninterrupted

DRAWING = {"plotly": ("plotly.graph_objects",), "dash": ()}  # packages, with their modules; loaded with all else


@functools.cache
def load_open3d():
    """The module `open3d`. The first call takes half a second; interrupted, it could not be loaded again."""
    with uninterrupted(), _without_drawing():
        import open3d
    return open3d


@contextmanager
def _without_drawing() -> Iterator[None]:
    """Put off the import of what nobody has imported yet until Open3D draws by it: it takes as long as all else."""
    packages = [package for package in DRAWING if package not in sys.modules]
    absent = [name for package in packages for name in (package, *DRAWING[package])]
    for name in absent:
        sys.modules[name] = _Later(functools.partial(importlib.import_module, name))
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


class _Later:
    """A module, or something in it, that is found when it is first called."""

    def __init__(self, find: Callable):
        self._find = find

    def __getattr__(self, name: str) -> "_Later":
        if name.startswith("__"):
            raise AttributeError(name)
        return _Later(lambda: getattr(self._find(), name))

    def __call__(self, *args, **kwargs):
        return self._find()(*args, **kwargs)
