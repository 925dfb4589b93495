"""Record of a comparison: a property of the test, which also reaches JUnit files and other processes."""

import json
from collections.abc import Iterable
from typing import NamedTuple

PROPERTY = "gsgi_screenshot"
UPDATE = ("same", "driver", "family")  # which golden image an update writes


def percent(share: float) -> str:
    """A share as messages and reports spell it."""
    return f"{100 * share:.4g} %"


def number(value: float) -> str:
    """A number as messages and reports spell it."""
    return f"{value:.4g}"


FIGURES = {"FLIP mean": number, "pixels off": percent}  # those that decide, with the function that spells each


class Record(NamedTuple):
    """One comparison: the id of the `test`, the `name` of the screenshot, and an `outcome`.

    The outcome is "equal" (to the bit), "close", "failed", or "written" (by an update). `golden` is the golden image
    for all drivers, `used` the one that was compared or written ("" if there is none). `figures` are those of FIGURES,
    each with its limit (none for equal images, or without an image to compare with). A failure has a `message`, and
    `pictures` by what they show. Paths inside pytest's root folder are relative to it.
    """

    test: str
    name: str
    outcome: str
    golden: str
    used: str
    figures: dict[str, tuple[float, float]]
    message: str
    pictures: dict[str, str]


def records_in(properties: Iterable[tuple[str, object]]) -> list[Record]:
    """The records among a test's properties."""
    return [Record(**json.loads(value)) for name, value in properties if name == PROPERTY]
