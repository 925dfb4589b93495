"""Errors in the user's data or machine, each with the exit code that the command line returns for it."""


class GsgiError(Exception):
    """Base of the errors that a user can cause and mend. One line of text; `exit_code` is documented in README.

    What the glTF reader raises names its kind by a `code` (see problems.py) and its place by a JSON `pointer`.
    """

    exit_code = 4

    def __init__(self, message: str = "", code: str = "", pointer: str = ""):
        super().__init__(message)
        self.code, self.pointer = code, pointer


class UsageError(GsgiError):
    """A request that makes no sense: a camera name that the scene lacks, images of different size."""

    exit_code = 1


class FileError(GsgiError):
    """A file that cannot be read or written."""

    exit_code = 2

    def __init__(self, message: str = "", code: str = "FILE", pointer: str = ""):
        super().__init__(message, code, pointer)


class SceneError(GsgiError):
    """A glTF scene that is broken. Names the file, the JSON pointer or byte, what was expected and what stood there."""

    exit_code = 3


class FormatError(GsgiError):
    """A .gsgi file that is broken. Names the byte offset, what was expected and what stood there."""

    exit_code = 3


class TargetError(GsgiError):
    """A target that was not met; the best that was found is written."""

    exit_code = 6


class UnsupportedError(GsgiError):
    """Valid input that this version, or this machine, cannot handle."""

    exit_code = 5
