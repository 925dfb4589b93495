"""Read skins of a glTF file at their rest pose."""

import numpy as np

from . import accessors
from .accessors import Layout
from .document import Document
from .json_value import Json
from .problems import Code

MATRICES = Layout(("MAT4",))


def joint_matrices(document: Document, index: Json, world_from_node: dict[str, np.ndarray]) -> np.ndarray:
    """world_from_bound (J, 4, 4) of a skin: the world matrix of each joint times its inverse bind matrix.

    `world_from_node` maps the JSON pointers of the scene's nodes to matrices. Raises SceneError, also for a joint
    outside the scene. Source: glTF 2.0, 3.7.3.
    """
    skin = document.lookup("skins", index)
    joints = []
    for joint in skin.get("joints").items():
        node = document.lookup("nodes", joint)
        if node.pointer not in world_from_node:
            raise index.refuse("a skin with joints within the scene", f"{joint.pointer} outside it", Code.MISSING)
        joints.append(world_from_node[node.pointer])
    if not joints:
        raise skin.get("joints").refuse("a joint", code=Code.MISSING)
    matrices = np.stack(joints)
    if "inverseBindMatrices" in skin:
        bind = skin.get("inverseBindMatrices")
        inverse = accessors.floats(document, bind, MATRICES).reshape(-1, 4, 4).transpose(0, 2, 1)
        if len(inverse) < len(joints):
            raise bind.refuse(f"{len(joints)} matrices, one for each joint", str(len(inverse)), Code.COUNT_MISMATCH)
        with np.errstate(over="ignore", invalid="ignore"):
            matrices = matrices @ inverse[: len(joints)].astype(np.float64)
    if not np.isfinite(matrices).all():
        raise skin.refuse("finite joint matrices", "an overflow", Code.OVERFLOW)
    return matrices
