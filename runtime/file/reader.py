"""A .gsgi file on disk as a `Bake`."""

from pathlib import Path

from gsgi.runtime.errors import FormatError
from gsgi.runtime.files import read_file
from gsgi.runtime.gaussians import Bake

from . import codec


def read_bake(path: str | Path) -> Bake:
    """The bake in a .gsgi file. Raises FileError or FormatError, both naming the file."""
    try:
        return codec.decode(read_file(Path(path)))
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error
