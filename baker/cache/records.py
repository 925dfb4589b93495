"""Convert records of arrays and numbers to flat dicts of arrays, and back."""

import dataclasses

import numpy as np


def to_arrays(record, prefix: str = "") -> dict[str, np.ndarray]:
    """The fields of a dataclass by name; fields of a nested record are named "outer.inner"."""
    arrays = {}
    for field in dataclasses.fields(record):
        name, value = prefix + field.name, getattr(record, field.name)
        arrays |= to_arrays(value, f"{name}.") if dataclasses.is_dataclass(value) else {name: np.asarray(value)}
    return arrays


def from_arrays(kind: type, arrays: dict[str, np.ndarray], prefix: str = ""):
    """The record of type `kind` that `to_arrays` took apart."""
    values = {}
    for field in dataclasses.fields(kind):
        name = prefix + field.name
        if dataclasses.is_dataclass(field.type):
            values[field.name] = from_arrays(field.type, arrays, f"{name}.")
        else:
            values[field.name] = arrays[name] if field.type is np.ndarray else field.type(arrays[name])
    return kind(**values)
