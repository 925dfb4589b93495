"""JSON on stdout, for machines."""

import json

import numpy as np


def print_json(value) -> None:
    """Print numbers, also numpy's, and records; everything else as text."""

    def convert(item):
        return item.item() if isinstance(item, np.generic) else str(item)

    print(json.dumps(value, indent=2, default=convert))
