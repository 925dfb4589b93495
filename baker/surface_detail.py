"""Measure how detailed a scene's surfaces are, to decide how many Gaussians its light needs."""

import numpy as np

from gsgi.baker.views.surface_points import Triangles

POINTS, PROBES, NEIGHBOURS = 1 << 15, 1 << 12, 8
BENT_SINE, BENT_COSINE = 0.25, 0.7  # of the angle from the tangent plane to a neighbour; of that between normals

# Gaussians if every neighbour is bent, and if none is. `./dev bench dial` shows the accuracy of fewer and more.
PER_SCENE, FEWEST = 1 << 17, 1 << 11


def gaussians_for(triangles: Triangles, seed: int) -> int:
    """Number of Gaussians that the detail calls for: at least 2^11 (one flat wall), 4,800 for a Cornell box."""
    return max(round(PER_SCENE * bent_share(triangles, seed)), FEWEST)


def bent_share(triangles: Triangles, seed: int) -> float:
    """Share of the 8 nearest neighbours, over random surface points, that do not continue the surface flatly.

    The points are 4,096 of 32,768, and their neighbours are found among all of them.
    """
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    points = triangles.draw(POINTS, rng)
    probe = rng.choice(POINTS, PROBES, replace=False)
    _, neighbour = cKDTree(points.position).query(points.position[probe], k=NEIGHBOURS + 1)
    way = points.position[neighbour[:, 1:]] - points.position[probe][:, None]
    normal = points.normal[probe][:, None]
    rise = np.abs((way * normal).sum(axis=2)) > BENT_SINE * np.linalg.norm(way, axis=2)
    turn = np.abs((points.normal[neighbour[:, 1:]] * normal).sum(axis=2)) < BENT_COSINE
    return float((rise | turn).mean())
