"""What each pass of a frame costs: GPU and CPU time, quads, fragments."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import moderngl


@dataclass
class PassCost:
    """Of all draws of one pass in a frame. `gpu_ms` by the driver's timer; `cpu_ms` until all was handed to the driver:
    culling, sorting, upload; `quads`: Gaussians drawn; `fragments` that passed the depth test, all of them blended
    where the pass blends."""

    name: str
    gpu_ms: float = 0.0
    cpu_ms: float = 0.0
    quads: int = 0
    fragments: int = 0


class Profile:
    """Costs of the passes that ran, in their order. Waits for the GPU after each, so the frame as a whole is slower."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx, self._passes = ctx, {}

    @property
    def passes(self) -> tuple[PassCost, ...]:
        """Each pass once, however often it ran."""
        return tuple(self._passes.values())

    @contextmanager
    def measure(self, name: str) -> Iterator[PassCost]:
        """Adds what is drawn inside to the pass `name`. Not to be nested."""
        cost = self._passes.setdefault(name, PassCost(name))
        query = self._ctx.query(samples=True, time=True)
        start = time.perf_counter()
        with query:
            yield cost
            cost.cpu_ms += 1e3 * (time.perf_counter() - start)
        cost.gpu_ms += 1e-6 * query.elapsed
        cost.fragments += query.samples


@contextmanager
def measured(profile: Profile | None, name: str) -> Iterator[PassCost]:
    """As `profile` measures; without one, as if nothing was there."""
    if profile is None:
        yield PassCost(name)
    else:
        with profile.measure(name) as cost:
            yield cost
