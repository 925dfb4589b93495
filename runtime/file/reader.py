"""A .gsgi file on disk as a `Bake`."""

from pathlib import Path

from gsgi.runtime.errors import FormatError
from gsgi.runtime.files import read_file
from gsgi.runtime.gaussians import Bake

from . import codec


def read_bake(path: str | Path) -> Bake:
    """The bake in a .gsgi file. Raises FileError or FormatError, both naming the file."""
    return decoded(read_file(Path(path)), path)


def decoded(data: bytes, path: str | Path) -> Bake:
    """The bake in the bytes of a .gsgi file. Raises FormatError, which names the file."""
    try:
        return codec.decode(data)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error
