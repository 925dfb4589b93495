"""How detailed a scene's surfaces are, and so how many Gaussians its light calls for."""

import numpy as np

from gsgi.baker.views.surface_points import Triangles

POINTS, PROBES, NEIGHBOURS = 1 << 15, 1 << 12, 8
BENT_SINE, BENT_COSINE = 0.25, 0.7  # of the way to a neighbour over the tangent plane; between normals

# Gaussians where every probe is bent, and where none is. `./dev bench dial` shows what fewer and more reach.
PER_SCENE, FEWEST = 1 << 17, 1 << 11


def gaussians_for(triangles: Triangles, seed: int) -> int:
    """How many Gaussians a bake of medium quality takes: from 2^11 for one flat wall on, 4,800 for a Cornell box."""
    return max(round(PER_SCENE * bent_share(triangles, seed)), FEWEST)


def bent_share(triangles: Triangles, seed: int) -> float:
    """Share of 8 neighbours of random surface points, of 32,768 in all, that do not continue the surface flatly."""
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
