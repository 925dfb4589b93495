"""What can be wrong with a glTF file: stable codes, and the record of one finding."""

from dataclasses import dataclass
from enum import StrEnum


class Code(StrEnum):
    """The kind of an error or warning. Programs may rely on these words: none changes its meaning."""

    # Errors: the file is broken.
    FILE = "FILE"  # a file cannot be read
    CONTAINER = "CONTAINER"  # neither GLB nor JSON, or a damaged GLB
    JSON_SYNTAX = "JSON_SYNTAX"  # not JSON, or not UTF-8
    JSON_TYPE = "JSON_TYPE"  # a value of another type than the schema's
    MISSING = "MISSING"  # a member that must be there is not
    VALUE_RANGE = "VALUE_RANGE"  # a value of the right type that is not allowed
    INDEX_RANGE = "INDEX_RANGE"  # an index beyond what it points into
    COUNT_MISMATCH = "COUNT_MISMATCH"  # two counts that must be equal
    NODE_CYCLE = "NODE_CYCLE"  # a node below itself
    NODE_PARENT = "NODE_PARENT"  # a node with two parents, or a root with one
    BOUNDS = "BOUNDS"  # an accessor, view or buffer that leaves its bytes
    ALIGNMENT = "ALIGNMENT"
    NON_FINITE = "NON_FINITE"  # NaN or infinity where numbers are expected
    OVERFLOW = "OVERFLOW"  # a product that its numbers cannot hold
    URI = "URI"  # not a data: URI or relative path
    URI_OUTSIDE = "URI_OUTSIDE"  # a path that leaves the scene's folder
    IMAGE = "IMAGE"  # an image that cannot be decoded
    DECODE = "DECODE"  # compressed data that cannot be decoded
    NO_TRIANGLES = "NO_TRIANGLES"
    LIMIT = "LIMIT"  # larger than a limit that the user can raise
    # Errors: valid, but beyond this version or machine.
    VERSION = "VERSION"
    UNSUPPORTED_EXTENSION = "UNSUPPORTED_EXTENSION"
    UNSUPPORTED = "UNSUPPORTED"
    NOT_INSTALLED = "NOT_INSTALLED"  # a decoder's Python package
    # Warnings.
    EXTENSION_IGNORED = "EXTENSION_IGNORED"
    SIMPLIFIED = "SIMPLIFIED"  # a material counts as less than it states
    TRANSPARENT = "TRANSPARENT"  # a partly transparent material is a hole, opaque or left out
    FROZEN = "FROZEN"  # a skin, morph targets or animations at rest
    NOT_TRIANGLES = "NOT_TRIANGLES"  # points and lines are left out
    INCOMPLETE = "INCOMPLETE"  # indices behind the last whole triangle
    NO_UV = "NO_UV"  # a texture on a primitive without texture coordinates
    CAMERA_IGNORED = "CAMERA_IGNORED"


@dataclass(frozen=True)
class Problem:
    """One finding: `severity` "error" or "warning", the place as a JSON pointer ("" for the file), one line of text."""

    severity: str
    code: str
    pointer: str
    message: str
