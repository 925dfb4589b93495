"""Typed access to JSON values that know their JSON pointer, which error messages state."""

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gsgi.runtime.errors import SceneError, UnsupportedError

from .problems import Code

MAX_INTEGER = 2**53  # largest integer up to which a double represents every integer
REQUIRED = object()


@dataclass(frozen=True, slots=True)
class Json:
    """A value at `pointer` (RFC 6901) in the JSON text of `file`. Every typed getter raises SceneError."""

    file: str
    pointer: str
    data: object

    def refuse(self, expected: str, got: str | None = None, code: Code = Code.VALUE_RANGE) -> SceneError:
        """Return an error that names this place; `got` defaults to a description of the value."""
        text = f"{self.where()}: expected {expected}, got {got or _describe(self.data)}"
        return SceneError(text, code, self.pointer)

    def unsupported(self, what: str, code: Code = Code.UNSUPPORTED) -> UnsupportedError:
        """Return an error for valid input at this place that the reader cannot handle."""
        return UnsupportedError(f"{self.where()}: {what}", code, self.pointer)

    def where(self) -> str:
        """File and pointer, the prefix of error messages."""
        return f"{self.file}: {self.pointer or '/'}"

    def __contains__(self, key: str) -> bool:
        return key in self.object()

    def get(self, key: str, default: object = REQUIRED) -> "Json":
        """Member `key` of this object, or the default at the same pointer if the member is absent."""
        value = self.object().get(key, default)
        if value is REQUIRED:
            raise self.refuse(f"a member {json.dumps(key)}", "none", Code.MISSING)
        return Json(self.file, f"{self.pointer}/{_escape(key)}", value)

    def extension(self, name: str) -> "Json | None":
        """The extension `name` of this object, or None."""
        extensions = self.get("extensions", {})
        return extensions.get(name) if name in extensions else None

    def item(self, index: int) -> "Json":
        """Element `index` of this array; the index must be valid."""
        return Json(self.file, f"{self.pointer}/{index}", self.array()[index])

    def items(self) -> Iterator["Json"]:
        """The elements of this array."""
        return (self.item(index) for index in range(len(self.array())))

    def object(self) -> dict:
        if not isinstance(self.data, dict):
            raise self.refuse("an object", code=Code.JSON_TYPE)
        return self.data

    def array(self) -> list:
        if not isinstance(self.data, list):
            raise self.refuse("an array", code=Code.JSON_TYPE)
        return self.data

    def boolean(self) -> bool:
        if not isinstance(self.data, bool):
            raise self.refuse("true or false", code=Code.JSON_TYPE)
        return self.data

    def string(self) -> str:
        """The text. Lone surrogates are refused because file names and terminals do not accept them."""
        if not isinstance(self.data, str):
            raise self.refuse("a string", code=Code.JSON_TYPE)
        try:
            self.data.encode()
        except UnicodeEncodeError:
            raise self.refuse("valid Unicode") from None
        return self.data

    def integer(self, low: int = 0, high: int = MAX_INTEGER) -> int:
        """An integer in [low, high]; 3.0 is accepted as 3, as in JSON Schema."""
        value = self.data
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        whole = isinstance(value, int) and not isinstance(value, bool)
        if not whole or not low <= value <= high:
            code = Code.VALUE_RANGE if whole else Code.JSON_TYPE
            raise self.refuse(f"an integer from {low} to {high}", code=code)
        return value

    def choice(self, *allowed: int | str) -> int | str:
        """One of the allowed values."""
        if isinstance(self.data, bool | list | dict) or self.data not in allowed:
            code = Code.VALUE_RANGE if isinstance(self.data, type(allowed[0])) else Code.JSON_TYPE
            raise self.refuse(f"one of {', '.join(map(json.dumps, allowed))}", code=code)
        return self.data

    def number(self, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number in [low, high] as a float."""
        value = self.data
        valid = isinstance(value, int | float) and not isinstance(value, bool)
        # Python integers can be larger than any float.
        if not valid or not -sys.float_info.max <= value <= sys.float_info.max or not low <= value <= high:
            limits = "" if (low, high) == (-math.inf, math.inf) else f" in [{low:g}, {high:g}]"
            raise self.refuse(f"a finite number{limits}", code=Code.VALUE_RANGE if valid else Code.JSON_TYPE)
        return float(value)

    def vector(self, length: int, low: float = -math.inf, high: float = math.inf) -> np.ndarray:
        """`length` finite numbers in [low, high]: (length,) float64."""
        if len(self.array()) != length:
            raise self.refuse(f"an array of {length} numbers")
        return np.array([value.number(low, high) for value in self.items()])


def parse(text: bytes, file: str) -> Json:
    """The root of the document, an object. Raises SceneError for anything that is not strict JSON in UTF-8."""
    try:
        data = json.loads(text.decode(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:  # ValueError: not UTF-8, not JSON, or more than 4,300 digits
        reason = "JSON nested too deeply" if isinstance(error, RecursionError) else error
        raise SceneError(f"{file}: expected JSON, got an error: {reason}", Code.JSON_SYNTAX) from None
    root = Json(file, "", data)
    root.object()
    return root


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def _escape(key: str) -> str:
    return key.replace("~", "~0").replace("/", "~1")


def _describe(data: object) -> str:
    """A short description of a JSON value on one line."""
    if isinstance(data, dict):
        return "an object"
    if isinstance(data, list):
        return f"an array of {len(data)}"
    if isinstance(data, int) and abs(data) > MAX_INTEGER:
        return "an integer beyond 2^53"
    text = json.dumps(data)
    return text if len(text) <= 60 else text[:57] + "..."
