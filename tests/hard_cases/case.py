"""A hard case, and how it is run in a layer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import moderngl
import pytest

GL_LAYERS = "llvmpipe", "softpipe", "look-up", "frame", "frame of over", "drop-in"


class Tolerance(NamedTuple):
    """The largest error that is right, and where that bound comes from."""

    value: float
    source: str


class Question(Protocol):
    """What is built, and what each layer answers."""

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """The worst error in a layer. Raises AssertionError for an answer that has no such measure.

        `gl` is a current context, or None in layers that are not in GL_LAYERS.
        """
        ...


@dataclass(frozen=True)
class Case:
    """A hard case.

    `holds` says in words what must hold, `tolerances` how nearly and why, for each layer that the case applies to.
    `build` makes the question. A case that must be refused has `refused`: the class of the exception, and what its
    message names. A case that is `slow` takes seconds and runs in `./dev hard` alone.
    """

    group: str
    name: str
    holds: str
    build: Callable[[], Question]
    tolerances: Mapping[str, Tolerance]
    refused: tuple[type[Exception], str] | None = None
    slow: bool = False

    @cached_property
    def question(self) -> Question:
        return self.build()

    def error(self, layer: str, gl: moderngl.Context | None = None) -> float:
        """The worst error in one layer; 0 for a case that is refused as it must be."""
        if self.refused is None:
            return self.question.error(layer, gl)
        kind, named = self.refused
        with pytest.raises(kind, match=named) as refusal:
            self.question.error(layer, gl)
        assert "\n" not in str(refusal.value), "a refusal is one line"
        return 0.0


@dataclass(frozen=True)
class Measured:
    """A question that each layer answers by a function of its own, which returns the worst error."""

    layers: Mapping[str, Callable[[moderngl.Context | None], float]]

    def error(self, layer: str, gl: moderngl.Context | None) -> float:
        """What the layer's function returns."""
        return self.layers[layer](gl)
