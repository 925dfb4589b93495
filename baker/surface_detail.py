"""Decide how many Gaussians a scene's light needs: by its detail, its number of spaces, and how the light varies."""

import numpy as np

from gsgi.baker.views.importance import ImportanceField

PROBES, NEIGHBOURS = 1 << 12, 8
BENT_SINE, BENT_COSINE = 0.25, 0.7  # of the angle from the tangent plane to a neighbour; of that between normals

# Gaussians if every neighbour is bent, and if none is. `gsgi tradeoff` shows the accuracy of fewer and more.
PER_SCENE, FEWEST = 27 << 12, 1 << 11

# Least for each space out of sight of the others. With `surface`, medium quality has 260 of them, as in a plain room; a
# city of 144 towers, some 90 spaces, had 60 for each by its detail alone, and wrong light in its alleys.
PER_SPACE = 9 << 7

# Gaussians if light varied by all that there is between neighbours everywhere. As many as bent neighbours call for in
# Sponza, and fewer in a Cornell box, where more changed no picture; twice as many in a chapel of few flat walls behind
# stained glass, where the worst view gained 0.015 SSIM.
PER_CONTRAST = 1 << 17


def gaussians_for(seen: ImportanceField) -> int:
    """Number of Gaussians that surfaces call for: at least 2^11 (one flat wall), 4,300 for a Cornell box."""
    return max(round(PER_SCENE * bent_share(seen)), round(PER_SPACE * seen.spaces), FEWEST)


def gaussians_for_light(contrast: float) -> int:
    """Number of Gaussians that light of this mean contrast calls for, which shapes may exceed."""
    return round(PER_CONTRAST * contrast)


def bent_share(points: ImportanceField) -> float:
    """Share of the 8 nearest neighbours, over points that people see, that do not continue the surface flatly.

    They are those of the first 4,096 points, found among all.
    """
    from scipy.spatial import cKDTree

    if len(points.position) <= NEIGHBOURS:
        return 0.0
    probe = slice(PROBES)
    _, neighbour = cKDTree(points.position).query(points.position[probe], k=NEIGHBOURS + 1)
    way = points.position[neighbour[:, 1:]] - points.position[probe][:, None]
    normal = points.normal[probe][:, None]
    rise = np.abs((way * normal).sum(axis=2)) > BENT_SINE * np.linalg.norm(way, axis=2)
    turn = np.abs((points.normal[neighbour[:, 1:]] * normal).sum(axis=2)) < BENT_COSINE
    return float((rise | turn).mean())
