"""Costs of the passes of a frame: GPU and CPU time, quads, fragments."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import moderngl

# moderngl cannot delete a query, so all profiles of a context share one.
_QUERIES: WeakKeyDictionary[moderngl.Context, moderngl.Query] = WeakKeyDictionary()


@dataclass
class PassCost:
    """Cost of all draws of one pass in a frame.

    `gpu_ms` comes from the driver's timer. `cpu_ms` is the time until everything was handed to the driver: culling,
    sorting, upload. `quads`: Gaussians drawn. `fragments`: those that passed the depth test; if the pass blends, all of
    them were blended.
    """

    name: str
    gpu_ms: float = 0.0
    cpu_ms: float = 0.0
    quads: int = 0
    fragments: int = 0


class Profile:
    """Costs of the passes that ran, in their order. Waits for the GPU after each pass, which slows down the frame."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx, self._passes = ctx, {}

    @property
    def passes(self) -> tuple[PassCost, ...]:
        """One entry per pass, even if it ran several times."""
        return tuple(self._passes.values())

    @contextmanager
    def measure(self, name: str) -> Iterator[PassCost]:
        """Add the cost of what is drawn inside to the pass `name`. Calls must not be nested."""
        cost = self._passes.setdefault(name, PassCost(name))
        query = _query_of(self._ctx)
        start = time.perf_counter()
        with query:
            yield cost
            cost.cpu_ms += 1e3 * (time.perf_counter() - start)
        cost.gpu_ms += 1e-6 * query.elapsed
        cost.fragments += query.samples


def _query_of(ctx: moderngl.Context) -> moderngl.Query:
    if ctx not in _QUERIES:
        _QUERIES[ctx] = ctx.query(samples=True, time=True)
        _QUERIES[ctx].ctx = None  # or the context would live as long as its query
    return _QUERIES[ctx]


@contextmanager
def measured(profile: Profile | None, name: str) -> Iterator[PassCost]:
    """Measure by `profile`; without one, only yield a cost that is not kept."""
    if profile is None:
        yield PassCost(name)
    else:
        with profile.measure(name) as cost:
            yield cost
