"""Count the paths that are traced."""

import pytest

from gsgi.baker.trace.tracer import Tracer


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that gets the number of paths of each later call of a tracer."""
    counts, trace = [], Tracer.indirect

    def counting(*arguments):
        light = trace(*arguments)
        counts.append(int(light.samples.sum()) + light.invalid)
        return light

    monkeypatch.setattr(Tracer, "indirect", counting)
    return counts
