"""Small worlds on disk."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Effects, SurfaceBlend
from gsgi.runtime.world.manifest import Manifest, encode, read_manifest, sectors_of

MARGIN = 0.25


def cells(*counts: int, edge: float = 2.0) -> np.ndarray:
    """Boxes (N, 2, 3) of a grid with so many cells along x, y and z."""
    low = np.array(list(np.ndindex(*counts)), float) * edge
    return np.stack([low, low + edge], axis=1)


def in_box(box: np.ndarray, seed: int, count: int = 40) -> Bake:
    """A bake of random Gaussians in a box and a little beyond, whose light depends on the seed."""
    fine, coarse = (oracle.random_gaussians(n, d, seed=seed, sloped=d == 0) for n, d in ((count, 0), (6, 2)))
    rng = np.random.default_rng(seed)
    moved = [
        replace(
            level,
            position=rng.uniform(box[0] - MARGIN, box[1] + MARGIN, (len(level), 3)).astype(np.float32),
            scale=rng.uniform(low, high, (len(level), 3)).astype(np.float32),
            sh=np.abs(level.sh) * np.float32(seed % 5 + 1),
        )
        for level, low, high in ((fine, 0.1, 0.5), (coarse, 0.8, 2.0))
    ]
    return codec.decode(codec.encode(Bake(moved[0], SurfaceBlend(), coarse=moved[1], scene=7)))


def write(
    folder: Path, bakes: Sequence[Bake], boxes: np.ndarray, margin: float = MARGIN, effects: Effects = Effects.EMISSIVE
) -> Path:
    """Write a world; return the path of its manifest."""
    files = []
    for number, bake in enumerate(bakes):
        data = codec.encode(bake)
        files.append((f"level.{number}-{hashlib.sha256(data).hexdigest()[:12]}.gsgi", data, codec.decode(data)))
        (folder / files[-1][0]).write_bytes(data)
    path = folder / "level.gsgi.json"
    path.write_bytes(encode(Manifest(path, 7, effects, margin, sectors_of(files, boxes))))
    read_manifest(path)
    return path


def random_world(folder: Path, *counts: int) -> Path:
    """A grid of sectors of random light."""
    boxes = cells(*counts)
    return write(folder, [in_box(box, seed) for seed, box in enumerate(boxes)], boxes)


def changed(path: Path, change) -> Path:
    """Change what a manifest says; `change` changes its value in place, or returns another."""
    value = json.loads(path.read_text())
    value = change(value) or value
    path.write_text(json.dumps(value))
    return path


def sector(n: int, **members):
    """A change of members of a sector."""
    return lambda value: value["sectors"][n].update(members)


# What no bake writes, by name: the change, and the beginning of the message.
LIES = {
    "another version": (lambda v: v.update(version=2), "version: expected 1, got 2"),
    "no manifest": (lambda _: [1], "expected an object, got [1]"),
    "another format": (lambda v: v.update(format=None), "format: expected 'gsgi world', got null"),
    "a member that is none": (lambda v: v.update(seed=1), "seed: expected no such member, got 1"),
    "a member too few": (lambda v: v.pop("margin") and None, 'margin: expected a value, got "none"'),
    "no sector": (lambda v: v.update(sectors=[]), "sectors: expected an array of 1 to 4096 values, got []"),
    "no margin": (lambda v: v.update(margin=0), "margin: expected more than 0, got 0.0"),
    "an unknown effect": (lambda v: v.update(effects=["fog"]), "effects: expected names of"),
    "a box inside out": (sector(1, high=[1, 2, 2]), "sectors[1].high: expected more than low, [2.0, 0.0, 0.0], got"),
    "boxes that overlap": (
        sector(1, low=[1.5, 0, 0]),
        "sectors[1]: expected a box of its own, got one that overlaps sectors[0]",
    ),
    "other neighbours": (sector(0, neighbours=[2]), "sectors[0].neighbours: expected [1], got [2]"),
    "a neighbour that is no sector": (sector(0, neighbours=[3]), "sectors[0].neighbours: expected a whole number"),
    "a number that is none": (
        sector(0, low=["a", 0, 0]),
        'sectors[0].low: expected a finite number, at most 1e12, got "a"',
    ),
    "an infinite number": (sector(0, low=[float("inf"), 0, 0]), "expected JSON: Infinity is no number of JSON"),
    "a file elsewhere": (
        sector(0, file="../level.gsgi"),
        'sectors[0].file: expected a path inside its folder, got "../level',
    ),
    "another size": (sector(2, bytes=7), "sectors[2].bytes: expected"),
}
