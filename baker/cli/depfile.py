"""What a build tool has to watch: the files that an output was made of, in the syntax of make."""

import re
from collections.abc import Iterable
from pathlib import Path

from gsgi.runtime.errors import UsageError

# What make or ninja takes for something else, however it is escaped.
UNSPEAKABLE = re.compile(r"[\x00-\x1f\x7f;*?|\"'`&<>()^=]")


def nameable(path: str | Path) -> bool:
    """Whether make, ninja and CMake all can be told of a file of this name."""
    return not UNSPEAKABLE.search(str(path)) and not str(path).endswith((":", "\\"))


def depfile(output: str, files: Iterable[Path]) -> bytes:
    """The rule `output: files`, each file once and spelled as it is given; those that are not `nameable` are left out.

    A rule without a recipe for each but the first lets make go on where one was deleted or renamed, as `gcc -MP`
    does. Raises UsageError for an output that no build tool can be told of.
    """
    if not nameable(output):
        raise UsageError(f"{output}: make and ninja cannot be told of an output of this name")
    names = [_escaped(str(file)) for file in dict.fromkeys(files) if nameable(file)]
    rules = [" \\\n  ".join([f"{_escaped(output)}:", *names]), *(f"{name}:" for name in names[1:])]
    return "".join(f"{rule}\n" for rule in rules).encode("utf-8", "surrogateescape")


def _escaped(name: str) -> str:
    """A name as make, ninja and CMake read it: backslashes count only in front of what they escape."""
    name = name.replace("$", "$$")
    name = re.sub(r"(\\*) ", r"\1\1\\ ", name)
    return re.sub(r"([#:])", r"\\\1", name)
