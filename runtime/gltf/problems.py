"""Problems of a glTF file: stable codes, and the record of one problem."""

from dataclasses import dataclass
from enum import StrEnum


class Code(StrEnum):
    """The kind of an error or warning. Programs may rely on these codes; their meaning never changes.

    `validate` also gives the codes of errors to warnings: about parts that the default scene does not use.
    """

    # Errors: the file is broken.
    FILE = "FILE"  # a file cannot be read
    CONTAINER = "CONTAINER"  # neither GLB nor JSON, or a damaged GLB
    JSON_SYNTAX = "JSON_SYNTAX"  # not JSON, or not UTF-8
    JSON_TYPE = "JSON_TYPE"  # a value whose type differs from the schema
    MISSING = "MISSING"  # a required member or element is absent
    VALUE_RANGE = "VALUE_RANGE"  # a value of the right type that is not allowed
    INDEX_RANGE = "INDEX_RANGE"  # an index beyond what it points into
    COUNT_MISMATCH = "COUNT_MISMATCH"  # two counts that do not match; a warning where one of them is known to count
    NODE_CYCLE = "NODE_CYCLE"  # a node that is its own descendant
    NODE_PARENT = "NODE_PARENT"  # a node with two parents; a warning for a root that has a parent or is listed twice
    BOUNDS = "BOUNDS"  # an accessor, view or buffer that exceeds its bytes
    ALIGNMENT = "ALIGNMENT"
    NON_FINITE = "NON_FINITE"  # NaN or infinity where finite numbers are expected
    OVERFLOW = "OVERFLOW"  # a computed value that its number type cannot hold
    URI = "URI"  # neither a data: URI nor a relative path
    URI_OUTSIDE = "URI_OUTSIDE"  # a path that leads outside the scene's folder
    IMAGE = "IMAGE"  # an image that cannot be decoded
    DECODE = "DECODE"  # compressed data that cannot be decoded
    NO_TRIANGLES = "NO_TRIANGLES"
    LIMIT = "LIMIT"  # larger than a limit; the user can raise all but the depth of nodes
    # Errors: valid, but not supported by this version or machine.
    VERSION = "VERSION"
    UNSUPPORTED_EXTENSION = "UNSUPPORTED_EXTENSION"
    UNSUPPORTED = "UNSUPPORTED"
    NOT_INSTALLED = "NOT_INSTALLED"  # the Python package of a decoder
    # Warnings.
    TRAILING_BYTES = "TRAILING_BYTES"  # bytes after the last chunk of a GLB
    EXTENSION_IGNORED = "EXTENSION_IGNORED"
    SIMPLIFIED = "SIMPLIFIED"  # a material that is read with less than it defines
    TRANSPARENT = "TRANSPARENT"  # a partly transparent material, which to light is a hole, opaque or absent
    FROZEN = "FROZEN"  # a skin, morph targets or animations that stay at rest
    NOT_TRIANGLES = "NOT_TRIANGLES"  # points and lines, which are left out
    INCOMPLETE = "INCOMPLETE"  # indices after the last whole triangle
    NO_UV = "NO_UV"  # a texture on a primitive without texture coordinates
    NO_POSITION = "NO_POSITION"  # a primitive without positions, which is left out
    NO_SOURCE = "NO_SOURCE"  # a texture without an image, which is left out
    CAMERA_IGNORED = "CAMERA_IGNORED"
    LIGHT_IGNORED = "LIGHT_IGNORED"
    METAL = "METAL"  # much metallic surface, which has no mirror images
    SIZE = "SIZE"  # a scene whose unit is hardly the metre


@dataclass(frozen=True)
class Problem:
    """One problem: `severity` "error" or "warning", JSON pointer ("" for the whole file), and one line of text."""

    severity: str
    code: str
    pointer: str
    message: str
