"""Points kept evenly apart: a random maximal Poisson-disk subset (Cook 1986; Gamito and Maddock 2009)."""

import numpy as np

# Disks of diameter r that random placement packs onto an area A: 0.547 of it is covered (Feder 1980), so N r^2 is this
# times A.
JAMMED = 0.547 * 4 / np.pi

ATTEMPTS = 4  # to find the radius
SURPLUS = 1.04  # more than this times the count is not even any more once the rest is left out at random


def thin(position: np.ndarray, normal: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (at most `count`) of points (N, 3) that lie evenly apart; of no more points than `count`, all.

    Only points whose normals (N, 3) lie less than a right angle apart are neighbours: the two sides of a thin wall do
    not thin each other out.
    """
    from scipy.spatial import cKDTree

    if len(position) <= count or count < 1:
        return np.arange(len(position))[:count]
    tree = cKDTree(position)
    radius = float(np.median(tree.query(position, k=2)[0][:, 1])) * np.sqrt(len(position) / count)
    best = np.arange(len(position))
    for _ in range(ATTEMPTS):
        chosen = _maximal(tree, normal, radius, rng.permutation(len(position)))
        if count <= len(chosen) < len(best):
            best = chosen
        if count <= len(best) <= SURPLUS * count:
            break
        radius *= np.sqrt(len(chosen) / count) if len(chosen) > count else np.sqrt(len(chosen) / (count * 1.02))
    return np.sort(rng.permutation(best)[:count])


def _maximal(tree, normal: np.ndarray, radius: float, rank: np.ndarray) -> np.ndarray:
    """Indices of points no two of which are neighbours, to which none can be added: the lowest `rank` wins."""
    pairs = tree.query_pairs(radius, output_type="ndarray")
    pairs = pairs[(normal[pairs[:, 0]] * normal[pairs[:, 1]]).sum(axis=1) > 0]
    chosen = np.zeros(len(rank), bool)
    open_ = np.ones(len(rank), bool)
    while open_.any():
        lowest = rank.copy()
        np.minimum.at(lowest, pairs[:, 0], rank[pairs[:, 1]])
        np.minimum.at(lowest, pairs[:, 1], rank[pairs[:, 0]])
        won = open_ & (lowest == rank)
        chosen |= won
        open_ &= ~won
        for a, b in ((0, 1), (1, 0)):
            open_[pairs[won[pairs[:, a]], b]] = False
        pairs = pairs[open_[pairs[:, 0]] & open_[pairs[:, 1]]]
    return np.flatnonzero(chosen)
