"""Errors that the user's data or machine causes, each with the exit code that the command line returns for it."""


class GsgiError(Exception):
    """Base of the errors that a user can cause and fix. The text is one line; README documents `exit_code`.

    Errors of the glTF reader state their kind as `code` (see gltf/problems.py) and their place as a JSON `pointer`.
    """

    exit_code = 4

    def __init__(self, message: str = "", code: str = "", pointer: str = ""):
        super().__init__(message)
        self.code, self.pointer = code, pointer


class UsageError(GsgiError):
    """An invalid request, such as a camera name that the scene lacks or images of different sizes."""

    exit_code = 1


class FileError(GsgiError):
    """A file that cannot be read or written."""

    exit_code = 2

    def __init__(self, message: str = "", code: str = "FILE", pointer: str = ""):
        super().__init__(message, code, pointer)


class SceneError(GsgiError):
    """A broken glTF scene. The text names the file, the JSON pointer or byte, the expected and the actual value."""

    exit_code = 3


class FormatError(GsgiError):
    """A broken .gsgi file. The text names the byte offset, the expected and the actual value."""

    exit_code = 3


class TargetError(GsgiError):
    """A target that was not met. The best result that was found is written."""

    exit_code = 6


class UnsupportedError(GsgiError):
    """Valid input that this version, or this machine, cannot handle."""

    exit_code = 5
