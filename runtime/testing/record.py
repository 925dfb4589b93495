"""What is passed on of each comparison: a property of the test, which also reaches JUnit files and other processes."""

import json
from collections.abc import Iterable
from typing import NamedTuple

PROPERTY = "gsgi_screenshot"
UPDATE = ("same", "driver", "family")  # which golden image an update writes


class Record(NamedTuple):
    """One comparison: the id of the `test`, the screenshot's `name`, and an `outcome`:

    "equal" to the bit, "close", "failed", or "written" by an update. `golden` is the golden image for all drivers,
    `used` the one that was compared or written ("" where there is none). A failure has its `message` and its `pictures`
    by what they show. Paths are relative to pytest's root folder.
    """

    test: str
    name: str
    outcome: str
    golden: str
    used: str
    message: str
    pictures: dict[str, str]


def records_in(properties: Iterable[tuple[str, object]]) -> list[Record]:
    """The records among a test's properties."""
    return [Record(**json.loads(value)) for name, value in properties if name == PROPERTY]
