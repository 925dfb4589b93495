"""The places of meshes that are drawn in many: which of them are seen, and their matrices on the GPU."""

import moderngl
import numpy as np

from gsgi.runtime.instance import ShapeGroup, moved, normal_matrix


class Copies:
    """Per-instance attributes of the meshes of `group`, for those places that a frustum may show.

    `count` is how many those are; none before the first cull().
    """

    def __init__(self, ctx: moderngl.Context, group: ShapeGroup):
        bounds = np.array([mesh.bounds() for mesh in group.meshes])
        low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
        linear = group.places[:, :3, :3]
        self._middle = np.array([moved((low + high) / 2, place) for place in group.places])
        self._edges = linear * (high - low) / 2  # (P, 3, 3): half an edge of the placed box in each column
        turned = np.array([normal_matrix(place) for place in group.places])
        turned /= np.abs(turned).max(axis=(1, 2), keepdims=True)
        parts = (matrices.transpose(0, 2, 1).reshape(len(matrices), -1) for matrices in (group.places, turned))
        self._rows = np.concatenate(list(parts), axis=1).astype(np.float32)
        self.buffer = ctx.buffer(reserve=self._rows.nbytes, dynamic=True)
        self._seen = np.zeros(len(self._rows), bool)

    @property
    def count(self) -> int:
        """How many places are drawn."""
        return int(np.count_nonzero(self._seen))

    def cull(self, clip_from_world: np.ndarray) -> None:
        """Draw from now on the places whose boxes reach into the frustum of a matrix (4, 4)."""
        # Gribb and Hartmann 2001, "Fast Extraction of Viewing Frustum Planes from the World-View-Projection Matrix"
        planes = np.concatenate([clip_from_world[3] + clip_from_world[:3], clip_from_world[3] - clip_from_world[:3]])
        reach = np.abs(planes[:, :3] @ self._edges).sum(axis=2)
        seen = (self._middle @ planes[:, :3].T + planes[:, 3] >= -reach).all(axis=1)
        if not np.array_equal(seen, self._seen):
            self._seen = seen
            self.buffer.orphan()
            self.buffer.write(self._rows[seen])

    def content(self, program: moderngl.Program) -> tuple:
        """The attributes that `program` reads, as a part of a vertex array."""
        if "normal_from_first" in program:
            return self.buffer, "16f 9f/i", "world_from_first", "normal_from_first"
        return self.buffer, "16f 36x/i", "world_from_first"
