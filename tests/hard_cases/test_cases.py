"""Every hard case that is not slow in every layer that it applies to, and the page that lists them all."""

import pytest

from . import softpipe
from .case import GL_LAYERS
from .cases import CASES
from .layers import ALL_SETS, INSTRUCTION_SETS
from .page import PAGE, page, without_numbers

PAIRS = [(case, layer) for case in CASES if not case.slow for layer in case.tolerances]
PAIRS.sort(key=lambda pair: pair[1] == softpipe.LAYER)  # at the end: it is slow, and answers from a process beside


@pytest.fixture(scope="module")
def from_softpipe(request):
    """A function of what softpipe makes of the cases, which is found beside the tests of other layers."""
    child = softpipe.start() if any(softpipe.LAYER in item.name for item in request.session.items) else None
    yield softpipe.answers
    if child is not None and child.poll() is None:
        child.kill()


@pytest.mark.parametrize(("case", "layer"), PAIRS, ids=[f"{case.name}, {layer}" for case, layer in PAIRS])
def test_case(request, from_softpipe, case, layer):
    if layer in ALL_SETS and layer not in INSTRUCTION_SETS:
        pytest.skip(f"this processor has no {layer}")
    if layer == softpipe.LAYER:
        if from_softpipe() is None:
            pytest.skip("Mesa has no softpipe here")
        error = from_softpipe()[case.name]
    else:
        error = case.error(layer, request.getfixturevalue("gl") if layer in GL_LAYERS else None)
    value, source = case.tolerances[layer]
    assert error <= value, f"{case.holds}; {source}"


def test_names_are_unique():
    assert len({case.name for case in CASES}) == len(CASES)


def test_the_page_lists_the_cases():
    assert without_numbers(PAGE.read_text(encoding="utf-8")) == without_numbers(page({})), "run ./dev hard"
