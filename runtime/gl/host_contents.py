"""What looks wrong in the contents of a host's textures, once they have been read as their encoding says."""

import ctypes
from typing import NamedTuple

import moderngl
import numpy as np

from .gl_functions import Functions
from .host_textures import Encoding
from .view import View

_TEXTURE_2D, _RGBA, _FLOAT = 0x0DE1, 0x1908, 0x1406

# Shares of the surfaces' pixels from which a finding is reported; what lies below occurs in rightly drawn frames.
_FEW, _MANY = 0.02, 0.5
_SHORTEST = 0.8  # of the longest normal: interpolation shortens them less
_BEHIND = -0.1  # cosine; flat triangles with smooth normals turn away this far at outlines
_ALIKE = 0.8  # cosine between a normal and that of the depth's gradient, in the median


class Points(NamedTuple):
    """What the light pass reads in a view, (H, W, ...) float32, row 0 as in the textures.

    `position` in world space, m; `normal` unit, 0 where the texel holds none; `texel` (H, W, 4) of the normal texture,
    as it is stored.
    """

    position: np.ndarray
    normal: np.ndarray
    texel: np.ndarray


def floats(gl: Functions, texture: moderngl.Texture, size: tuple[int, int]) -> np.ndarray:
    """Level 0 of a host's texture of `size` px, whatever its format: (H, W, 4) float32. Leaves it bound to unit 0."""
    found = np.empty((size[1], size[0], 4), np.float32)
    texture.use(0)
    gl.call("GetTexImage", _TEXTURE_2D, 0, _RGBA, _FLOAT, found.ctypes.data_as(ctypes.c_void_p))
    return found


def findings(points: Points, weight: np.ndarray, view: View, encoding: Encoding, box) -> list[str]:
    """One sentence for each finding, which begins with the argument that it is about.

    `weight` (H, W) is that of the light's fine level. `view` and `box` (two corners (3,), or None) are in the space of
    `points`. Surfaces outside `box` are left out.
    """
    offset = points.position - view.world_from_view[:3, 3].astype(np.float32)
    back = view.world_from_view[:3, 2]
    depth = -(offset @ back)
    finite = np.isfinite(depth)
    seen = finite & (np.abs(depth) > 0.01 * view.near)
    if not seen.any():
        return ["depth: no pixel shows a surface"]
    depth -= view.shift
    near, far = view.near - view.shift, _far(view)
    slack = 0.01 * (far - near if view.parallel else near)
    low, high = np.percentile(depth[seen], (0.1, 99.9))
    outside = (depth < near - slack) | (depth > far + max(slack, 0.01 * far))
    planes = f"{near:.3g} to {far:.3g} m: most lies at {low:.3g} to {high:.3g} m"
    found = [
        _share("depth", ~finite, "is not finite", 0),
        _share("depth", outside[seen], f"lies outside the planes of clip_from_view at {planes}"),
    ]
    if box is not None:
        seen &= ((points.position >= box[0]) & (points.position <= box[1])).all(axis=-1)
    if seen.any():
        towards = np.broadcast_to(back, offset.shape) if view.parallel else -offset
        found += _of_normals(points, towards, seen, encoding)
        why = "has no Gaussian: is it of this scene, in metres, and are depth and both matrices those of this frame?"
        found.append(_share("bake", weight[seen] <= 0, why, _MANY))
    return [*filter(None, found)]


def of_albedo(albedo: np.ndarray) -> list[str]:
    """Findings in the texels (H, W, 4) of an albedo."""
    outside = ~((albedo[..., :3] >= -0.01) & (albedo[..., :3] <= 1.01)).all(axis=-1)
    return [*filter(None, [_share("albedo", outside, "does not lie between 0 and 1")])]


def _far(view: View) -> float:
    """Distance, m, of the far plane from the host's eye, whichever clip space it is for; may be infinite."""
    z, one = view.z_to_clip
    if view.parallel:
        return 2 * view.near - view.shift
    # Far has z = w; in a reversed projection z = 0 or, where near would lie at half its distance, z = -w.
    slope = z + 1 if one < 0 else z if z <= 1 else z - 1
    return one / slope if slope * one > 0 else np.inf


def _of_normals(points: Points, towards: np.ndarray, seen: np.ndarray, encoding: Encoding) -> list[str | None]:
    """`towards` (H, W, 3): to the eye, of any length; `seen` (H, W) marks the surfaces."""
    normal, stored = points.normal[seen], points.texel[seen]
    empty = ~normal.any(axis=-1)
    found = [_share("normal", empty, "is empty")]
    if encoding.normal == "octahedral":
        broken = ~(np.abs(stored[:, :2]).max(axis=-1) <= 1.01)
        found.append(_share("normal", broken, "lies outside -1 ... 1, which octahedral normals do not"))
    elif encoding.normal == "octahedral unsigned":
        broken = ~(np.abs(stored[:, :2] - 0.5).max(axis=-1) <= 0.505)
        found.append(_share("normal", broken, "lies outside 0 ... 1, which unsigned octahedral normals do not"))
    elif not empty.all():
        xyz = stored[~empty, :3] * 2 - 1 if encoding.normal == "unsigned" else stored[~empty, :3]
        short, long = np.percentile(np.linalg.norm(xyz, axis=-1), (5, 95))
        if not short >= _SHORTEST * long:
            found.append(f'normal: as Encoding.normal "{encoding.normal}" it is {short:.2f} to {long:.2f} long')
    cosine = (normal * towards[seen]).sum(axis=-1) / np.linalg.norm(towards[seen], axis=-1)
    behind = cosine < _BEHIND
    found.append(_share("normal", behind, f"points away from the camera: is it in {encoding.normal_space} space?"))
    if (alike := _alike(points, seen)) < _ALIKE:
        found.append(
            f"normal: its cosine with the slopes of depth is {alike:.2f} in the median: are the encodings and both "
            "matrices those of this frame?"
        )
    return found


def _alike(points: Points, seen: np.ndarray) -> float:
    """Median cosine, without its sign, between normals and those of neighbouring positions."""
    right, up = (np.diff(points.position, axis=axis) for axis in (1, 0))
    across = np.cross(right[:-1], up[:, :-1])
    length = np.linalg.norm(across, axis=-1)
    whole = seen[:-1, :-1] & seen[:-1, 1:] & seen[1:, :-1] & (length > 0)
    if not whole.any():
        return 1.0
    cosine = (across * points.normal[:-1, :-1]).sum(axis=-1)[whole] / length[whole]
    return float(np.median(np.abs(cosine)))


def _share(name: str, which: np.ndarray, what: str, allowed: float = _FEW) -> str | None:
    """A finding if more than the share `allowed` of the pixels is affected."""
    share = float(np.mean(which))
    return f"{name}: in {share:.1%} of the pixels it {what}" if share > allowed else None
