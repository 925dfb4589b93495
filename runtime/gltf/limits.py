"""Limits on the size of a glTF scene, beyond which the reader refuses it."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

from gsgi.runtime.errors import SceneError, UsageError

from .problems import Code

WHAT = {
    "elements": "vertices and indices",
    "texels": "texels in all images",
    "nodes": "nodes and instances",
    "json_bytes": "bytes of JSON",
    "file_bytes": "bytes in a file",
}


@dataclass(frozen=True)
class Limits:
    """Limits against mistakes and attacks; users with more memory can raise them."""

    elements: int = 2**28  # of all meshes in world space, about 5 GiB; every instance counts
    texels: int = 2**29  # 2 GiB as RGBA, or 32 images of 4096 x 4096
    nodes: int = 2**20
    json_bytes: int = 64 << 20  # Python objects take up to 20 times the text; leaves room for embedded buffers
    file_bytes: int = 4 << 30  # a GLB stores its length in 32 bits

    def check(self, name: str, amount: int, where: str, pointer: str = "") -> None:
        """Raise a SceneError that names the limit if `amount` exceeds it."""
        limit = getattr(self, name)
        if amount > limit:
            text = f"expected at most {limit} {WHAT[name]} (raise it by --limit {name}=N), got {amount}"
            raise SceneError(f"{where}: {text}", Code.LIMIT, pointer)


def parse_limits(settings: Iterable[str]) -> Limits:
    """The default limits with changes from the command line, each "NAME=N". Raises UsageError."""
    changes = {}
    for setting in settings:
        name, _, number = setting.partition("=")
        name = name.replace("-", "_")
        if name not in WHAT or not number.isdecimal() or not 0 < int(number) < 2**63:
            raise UsageError(f"--limit: expected NAME=N with a NAME of {', '.join(WHAT)}, got {setting!r}")
        changes[name] = int(number)
    return dataclasses.replace(Limits(), **changes)
