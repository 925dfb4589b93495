"""Random pixels of references, at or before which the evaluation traces more paths."""

from collections.abc import Iterator, Mapping

import numpy as np

from gsgi.baker.trace.reference import Reference


def drawn(
    references: Mapping[str, Reference], points: int, rng: np.random.Generator
) -> Iterator[tuple[str, Reference, np.ndarray]]:
    """The name of each of the V references in which B is seen, itself, and valid pixels (ceil(points / V),) of it.

    Pixels are given as indices of the flat image, and one may be drawn more than once.
    """
    seen = {name: reference for name, reference in references.items() if reference.indirect.any()}
    for name, reference in seen.items():
        valid = np.flatnonzero(reference.valid)
        yield name, reference, valid[rng.integers(len(valid), size=-(-points // len(seen)))]


def at_pixels(references: Mapping[str, Reference], points: int, seed: int, *names: str) -> list[np.ndarray]:
    """What lies at the pixels that are `drawn` with a seed: columns (V, P, 3), or none if no B is seen.

    They are those of the surfaces with these names, and B.
    """
    pixels = [
        [
            image.reshape(-1, 3)[at]
            for image in (*(getattr(reference.surface, name) for name in names), reference.indirect)
        ]
        for _, reference, at in drawn(references, points, np.random.default_rng(seed))
    ]
    return [np.stack(column) for column in zip(*pixels, strict=True)]
