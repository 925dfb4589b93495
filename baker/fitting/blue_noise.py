"""Points kept evenly apart, a random maximal Poisson-disk subset (Cook 1986; Gamito and Maddock 2009); their spacing."""

import numpy as np

CANDIDATES = 5  # random points for each that stays (Yuksel 2015 finds no gain beyond five)
NEIGHBOURS = 3  # whose distance is a point's spacing

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
    nearest = (
        float(np.median(cKDTree(position).query(position, k=2)[0][:, 1]))
        or float(np.ptp(position)) / len(position)
        or 1.0
    )
    radius = nearest * np.sqrt(len(position) / count)
    best = np.arange(len(position))
    for _ in range(ATTEMPTS):
        chosen = _apart(position, normal, radius, rng.permutation(len(position)))
        if count <= len(chosen) < len(best):
            best = chosen
        if len(best) <= SURPLUS * count:
            break
        radius *= np.sqrt(len(chosen) / (count if len(chosen) > count else (1 + SURPLUS) / 2 * count))
    return np.sort(rng.permutation(best)[:count])


def spacing(position: np.ndarray) -> np.ndarray:
    """Mean distance (N,) float32, m, to the nearest NEIGHBOURS other points."""
    from scipy.spatial import cKDTree

    if len(position) <= NEIGHBOURS:
        extent = float(np.linalg.norm(np.ptp(position, axis=0))) if len(position) else 0.0
        return np.full(len(position), extent or 1.0, np.float32)
    distance, _ = cKDTree(position).query(position, k=NEIGHBOURS + 1)
    return distance[:, 1:].mean(axis=1).astype(np.float32)


def _apart(position: np.ndarray, normal: np.ndarray, radius: float, rank: np.ndarray) -> np.ndarray:
    """Indices of points no two of which are neighbours, and to which few could be added: the lowest `rank` wins.

    Of those in a cell so small that all in it are neighbours only the lowest takes part: a crowd costs no more pairs.
    """
    from scipy.spatial import cKDTree

    by_rank = np.argsort(rank)
    cell = np.floor(position[by_rank] / (radius / np.sqrt(3)))
    _, first = np.unique(np.column_stack([cell, normal[by_rank] > 0]), axis=0, return_index=True)
    left = np.sort(by_rank[first])
    pairs = left[cKDTree(position[left]).query_pairs(radius, output_type="ndarray")]
    pairs = pairs[(normal[pairs[:, 0]] * normal[pairs[:, 1]]).sum(axis=1) > 0]
    undecided, chosen = np.zeros(len(rank), bool), np.zeros(len(rank), bool)
    undecided[left] = True
    while undecided.any():
        lowest = rank.copy()
        np.minimum.at(lowest, pairs[:, 0], rank[pairs[:, 1]])
        np.minimum.at(lowest, pairs[:, 1], rank[pairs[:, 0]])
        won = undecided & (lowest == rank)
        chosen |= won
        undecided &= ~won
        for a, b in ((0, 1), (1, 0)):
            undecided[pairs[won[pairs[:, a]], b]] = False
        pairs = pairs[undecided[pairs].all(axis=1)]
    return np.flatnonzero(chosen)
