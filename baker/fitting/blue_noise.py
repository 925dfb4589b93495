"""Evenly spread subsets of points, and the spacing of points.

A subset is a random, almost maximal Poisson-disk set (Cook 1986; Gamito and Maddock 2009).
"""

import numpy as np

from gsgi.baker.neighbours import Neighbours

CANDIDATES = 5  # random points per point that is kept (Yuksel 2015 finds no gain beyond five)
AROUND = 24  # nearest other points, whose distance tells the density
NEIGHBOURS = 3  # a point's spacing is the mean distance to these

ATTEMPTS = 4  # at finding the radius
SURPLUS = 1.04  # dropping points at random from more than this times the count would leave gaps


def thin(position: np.ndarray, normal: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of at most `count` evenly spread points of `position` (N, D); all points if N is at most `count`.

    Only points whose normals (N, 3) are less than a right angle apart are neighbours, so that the two sides of a
    thin wall do not thin each other out.
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


def drawn(weight: np.ndarray, number: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of at most `number` different points, in their order, as likely as their `weight` (N,) says."""
    there = np.flatnonzero(weight)
    number = min(max(number, 0), len(there))
    return np.sort(rng.choice(there, number, replace=False, p=weight[there] / weight.sum())) if number else there[:0]


def levelled(position: np.ndarray) -> np.ndarray:
    """Points (N, 4) of nearly even density in place of points (N, 3) whose density differs by orders of magnitude.

    Where points lie four times as far apart as most, or sixteen times, and so on, they are scaled and moved away from
    the others, so that a subset that `thin` makes of the result is dense where the points are.
    """
    if len(position) < 2:
        return np.column_stack([position, np.zeros(len(position))])
    distance, _ = Neighbours(position).nearest(position, AROUND + 1)
    around = np.maximum(distance[:, -1], np.finfo(np.float32).tiny)
    power = np.log2(around) / 2
    common = np.angle(np.exp(2j * np.pi * power).mean()) / (2 * np.pi)  # of most points: no border lies among them
    step = np.rint(power - common)
    step -= np.round(np.median(step))
    scaled = position.astype(np.float64) * 4.0 ** -step[:, None]
    return np.column_stack([scaled, 4 * (float(np.ptp(scaled)) + 1) * step])


def spacing(position: np.ndarray) -> np.ndarray:
    """Mean distance (N,) float32, m, to the nearest NEIGHBOURS other points."""
    from scipy.spatial import cKDTree

    if len(position) <= NEIGHBOURS:
        extent = float(np.linalg.norm(np.ptp(position, axis=0))) if len(position) else 0.0
        return np.full(len(position), extent or 1.0, np.float32)
    distance, _ = cKDTree(position).query(position, k=NEIGHBOURS + 1)
    return distance[:, 1:].mean(axis=1).astype(np.float32)


def _apart(position: np.ndarray, normal: np.ndarray, radius: float, rank: np.ndarray) -> np.ndarray:
    """Indices of points without neighbours among them; of two neighbours the one of lower `rank` wins.

    Few points could be added to the subset. All points in one cell are neighbours, and only the one of lowest rank
    takes part, so that dense clusters add no pairs.
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
