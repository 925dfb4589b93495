"""Small worlds on disk."""

import hashlib
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


def write(folder: Path, bakes: Sequence[Bake], boxes: np.ndarray, margin: float = MARGIN) -> Path:
    """Write a world; return the path of its manifest."""
    files = []
    for number, bake in enumerate(bakes):
        data = codec.encode(bake)
        files.append((f"level.{number}-{hashlib.sha256(data).hexdigest()[:12]}.gsgi", data, codec.decode(data)))
        (folder / files[-1][0]).write_bytes(data)
    path = folder / "level.gsgi.json"
    path.write_bytes(encode(Manifest(path, 7, Effects.EMISSIVE, margin, sectors_of(files, boxes))))
    read_manifest(path)
    return path


def random_world(folder: Path, *counts: int) -> Path:
    """A grid of sectors of random light."""
    boxes = cells(*counts)
    return write(folder, [in_box(box, seed) for seed, box in enumerate(boxes)], boxes)
