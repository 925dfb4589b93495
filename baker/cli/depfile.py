"""Dependency files for build tools: the files that an output was made from, in the syntax of make."""

import re
from collections.abc import Iterable
from pathlib import Path

from gsgi.runtime.errors import UsageError

# Characters that make or ninja misreads, however they are escaped.
UNSPEAKABLE = re.compile(r"[\x00-\x1f\x7f;*?|\"'`&<>()^=]")


def nameable(path: str | Path) -> bool:
    """Whether a file of this name can be written in a rule for make, ninja and CMake."""
    return not UNSPEAKABLE.search(str(path)) and not str(path).endswith((":", "\\"))


def depfile(output: str, files: Iterable[Path]) -> bytes:
    """Return the rule `output: files`, each file once and spelled as given, without those that are not `nameable`.

    All files but the first also get a rule without a recipe, as with `gcc -MP`, so that make continues if one was
    deleted or renamed. Raises UsageError if the output is not `nameable`.
    """
    if not nameable(output):
        raise UsageError(f"{output}: make and ninja cannot be told of an output of this name")
    names = [_escaped(str(file)) for file in dict.fromkeys(files) if nameable(file)]
    rules = [" \\\n  ".join([f"{_escaped(output)}:", *names]), *(f"{name}:" for name in names[1:])]
    return "".join(f"{rule}\n" for rule in rules).encode("utf-8", "surrogateescape")


def _escaped(name: str) -> str:
    """Escape a name for make, ninja and CMake. Backslashes are special only before a character that needs escaping."""
    name = name.replace("$", "$$")
    name = re.sub(r"(\\*) ", r"\1\1\\ ", name)
    return re.sub(r"([#:])", r"\\\1", name)
