"""JSON on stdout, for machines."""

import json

import numpy as np


def print_json(value) -> None:
    """Print a value as JSON, with numpy's numbers as numbers and unknown types as text."""

    def convert(item):
        return item.item() if isinstance(item, np.generic) else str(item)

    print(json.dumps(value, indent=2, default=convert))
