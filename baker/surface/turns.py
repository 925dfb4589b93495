"""Turns of a fit: early steps look at a part of the samples, in each turn at another one, which tells as much."""

from collections.abc import Callable, Mapping

from .optimiser import SurfaceOptimiser


class Turns:
    """Optimisers against every n-th sample, and in the end against the `whole`, all of them."""

    def __init__(self, parts: Mapping[float, int], steps: int, length: int, make: Callable[[slice], SurfaceOptimiser]):
        """From each share of the `steps` in `parts` on, which begin at 0 and ascend, every how many-th sample counts.

        A turn has `length` steps. `make` makes the optimiser against the samples of a slice.
        """
        self._parts, self._steps = parts, steps
        self._length, self._make = length, make
        self._made: dict[tuple[int, int], SurfaceOptimiser] = {}
        self.whole = make(slice(None))

    def part(self, step: int) -> slice:
        """Which samples count in the turn of this step, from 0."""
        count = every(self._parts, step / self._steps if self._steps else 1.0)
        return slice(step // self._length % count, None, count)

    def at(self, step: int) -> SurfaceOptimiser:
        """The optimiser against these samples. It is made once, but for those of other sizes are forgotten then."""
        part = self.part(step)
        if part.step == 1:
            self._made.clear()
            return self.whole
        which = part.start, part.step
        if which not in self._made:
            self._made = {other: made for other, made in self._made.items() if other[1] == part.step}
            self._made[which] = self._make(part)
        return self._made[which]


def every(parts: Mapping[float, int], share: float) -> int:
    """Every how many-th sample counts after this share of the steps."""
    return [count for start, count in parts.items() if start <= share][-1]


def mean_part(parts: Mapping[float, int]) -> float:
    """The share of the samples that counts, as a mean over all steps."""
    ends = [*list(parts)[1:], 1.0]
    return sum((end - start) / count for (start, count), end in zip(parts.items(), ends, strict=True))
