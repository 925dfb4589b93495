"""Groups of lights that lie close together, among which the path tracer chooses first."""

import heapq

import numpy as np

CLUSTERS = 64  # most; a table of them per cell stays small
WHOLE = 2  # the turn of a cluster that is not halved


def clusters(centre: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """The number of its cluster for each of L lights: (L,) int, from 0 on.

    `centre` (L, 3), m, is not finite for lights without a place, which are clusters of their own as far as there are
    enough. `extent` (L,) is each light's size, m. The widest cluster is halved again and again; those whose lights are
    as wide as the whole, such as tubes, come last, and two such lights, as of a panel, stay together.
    """
    result = np.zeros(len(centre), np.int64)
    placed = np.isfinite(centre).all(axis=1)
    apart = np.flatnonzero(~placed)
    result[apart] = np.minimum(np.arange(len(apart)), CLUSTERS // 2 - 1)
    count = min(len(apart), CLUSTERS // 2)
    waiting = [_part(centre, extent, np.flatnonzero(placed))] if placed.any() else []
    while waiting and count + len(waiting) < CLUSTERS and waiting[0][0] < WHOLE:
        _, _, _, members, axis, middle = heapq.heappop(waiting)
        low = centre[members, axis] <= middle
        for half in (members[low], members[~low]):
            heapq.heappush(waiting, _part(centre, extent, half))
    for number, (_, _, _, members, *_) in enumerate(sorted(waiting, key=lambda part: part[2])):
        result[members] = count + number
    return result


def _part(centre: np.ndarray, extent: np.ndarray, members: np.ndarray) -> tuple:
    """What orders a cluster of these members, WHOLE if it stays so, and where it is halved."""
    low, high = centre[members].min(axis=0), centre[members].max(axis=0)
    axis = int(np.argmax(high - low))
    width = high[axis] - low[axis]
    middle = (low[axis] + high[axis]) / 2
    turn = 0 if width > extent[members].max() else 1 if len(members) > 2 and low[axis] <= middle < high[axis] else WHOLE
    return turn, -float(width), int(members[0]), members, axis, middle
