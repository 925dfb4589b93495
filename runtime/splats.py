"""A bake as Gaussians that viewers of 3D Gaussian splatting open: what is left of its light, as .ply or .glb."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .constants import SH_C0
from .display import auto_exposure, tone_map
from .errors import UsageError
from .gaussians import Bake, OverBlend
from .quaternions import rotation_matrices
from .sampling import sh_basis
from .vectors import sphere

FORMATS = ".ply", ".glb"
DIRECTIONS = 64  # in which the colours of an `over` bake are fitted
CHUNK = 1 << 14  # Gaussians at once
OPACITY_MIN = 1 / 1024  # and as far below 1: the logit is finite
EXTENSION = "KHR_gaussian_splatting"
GLB_START = b'"generator":"gsgi"},"extensionsUsed":["KHR_gaussian_splatting"]'  # what tells our .glb from others


@dataclass(frozen=True)
class Splats:
    """N Gaussians in world space, activated, to be blended along the ray.

    position (N, 3), m; rotation (N, 4) xyzw; scale (N, 3), m; opacity (N,) in (0, 1); sh (N, K, 3): display-referred
    sRGB is 1/2 + sum over k of sh[k] Y_k(d), in the direction d from the eye. All float32. `exposure` is the factor
    on the light before the tone curve.
    """

    position: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray
    opacity: np.ndarray
    sh: np.ndarray
    exposure: float


def splats_of(bake: Bake) -> Splats:
    """The fine level of a bake, B as a viewer shows it: at one exposure, after the tone curve.

    The exposure maps the log-average of the Gaussians' light to mid-grey. A Gaussian of a `surface` bake has the light
    at its own normal, from all sides. Lost are weights by normal, slopes, relief, the coarse level, the parts of light
    groups, and values that a display has not. Raises UsageError for a bake without Gaussians.
    """
    level = bake.gaussians.clamped()
    if not len(level):
        raise UsageError("the bake has no Gaussians: there is nothing to write")
    if isinstance(bake.blend, OverBlend):
        exposure = auto_exposure(level.sh[:, :1] * np.float32(SH_C0))
        sh = np.concatenate([_seen(level.sh[i : i + CHUNK], exposure) for i in range(0, len(level), CHUNK)])
    else:
        basis = sh_basis(rotation_matrices(level.rotation)[:, :, 2], level.sh.shape[1])
        light = np.einsum("nk,nkc->nc", basis, level.sh)[:, None]
        exposure = auto_exposure(light)
        sh = (tone_map(light, exposure) - 0.5) / SH_C0
    opacity = np.clip(level.opacity, OPACITY_MIN, 1 - OPACITY_MIN)
    return Splats(level.position, level.rotation, level.scale, opacity, sh.astype(np.float32), exposure)


def _seen(sh: np.ndarray, exposure: float) -> np.ndarray:
    """Coefficients (N, K, 3) of what is shown of light with the coefficients `sh`, by least squares."""
    basis = sh_basis(sphere(DIRECTIONS), sh.shape[1])
    display = tone_map(np.einsum("dk,nkc->ndc", basis, sh), exposure)
    return np.einsum("kd,ndc->nkc", np.linalg.pinv(basis), display - np.float32(0.5))


def encode(splats: Splats, path: str | Path) -> bytes:
    """The content of a file by the ending of `path`, which check_path() accepts."""
    return _ply(splats) if Path(path).suffix == ".ply" else _glb(splats)


def check_path(path: str | Path) -> None:
    """Raise UsageError for a file name whose ending is none of FORMATS."""
    if Path(path).suffix not in FORMATS:
        raise UsageError(f"{path}: Gaussians are written as {' or '.join(FORMATS)}, probes with --probes")


def _ply(splats: Splats) -> bytes:
    """As the code of Kerbl et al. 2023 writes it: logarithms of scales, logits of opacities, quaternions wxyz.

    Its space has y down, so that all is turned by half a turn about z, which viewers undo.
    """
    count, k = splats.sh.shape[:2]
    order = np.concatenate([np.arange(-band, band + 1) for band in range(int(k**0.5))])
    turned = splats.sh * np.where(order % 2, -1, 1)[None, :, None]
    x, y, z, w = splats.rotation.T
    columns = dict(zip("xyz", (splats.position * [-1, -1, 1]).T, strict=True))
    columns |= {f"f_dc_{c}": turned[:, 0, c] for c in range(3)}
    columns |= {f"f_rest_{i}": values for i, values in enumerate(turned[:, 1:].transpose(2, 1, 0).reshape(-1, count))}
    columns |= {"opacity": np.log(splats.opacity) - np.log1p(-splats.opacity)}
    columns |= {f"scale_{axis}": values for axis, values in enumerate(np.log(splats.scale).T)}
    columns |= {f"rot_{i}": values for i, values in enumerate((-z, -y, x, w))}  # half a turn about z, then the rotation
    head = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {count}\n"
    head += "".join(f"property float {name}\n" for name in columns) + "end_header\n"
    return head.encode() + np.stack(list(columns.values()), axis=1).astype("<f4").tobytes()


def _glb(splats: Splats) -> bytes:
    """glTF 2.0 with KHR_gaussian_splatting (Khronos 2026), and COLOR_0 for viewers that show points."""
    color = np.concatenate([0.5 + SH_C0 * splats.sh[:, 0], splats.opacity[:, None]], axis=1)
    own = {"ROTATION": splats.rotation, "SCALE": splats.scale, "OPACITY": splats.opacity[:, None]}
    for band in range(int(splats.sh.shape[1] ** 0.5)):
        for i in range(2 * band + 1):
            own[f"SH_DEGREE_{band}_COEF_{i}"] = splats.sh[:, band * band + i]
    arrays = {"POSITION": splats.position, "COLOR_0": np.rint(np.clip(color, 0, 1) * 255).astype(np.uint8)}
    arrays |= {f"{EXTENSION}:{name}": array for name, array in own.items()}
    views, accessors, data = [], [], b""
    for array in arrays.values():
        content = array.tobytes()
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content), "target": 34962})
        accessor = {"bufferView": len(accessors), "componentType": 5126, "count": len(array)}
        accessor["type"] = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[array.shape[1]]
        if array.dtype == np.uint8:
            accessor |= {"componentType": 5121, "normalized": True}
        accessors.append(accessor)
        data += content
    accessors[0] |= {"min": splats.position.min(axis=0).tolist(), "max": splats.position.max(axis=0).tolist()}
    how = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    primitive = {"mode": 0, "attributes": {name: i for i, name in enumerate(arrays)}, "extensions": {EXTENSION: how}}
    root = {
        "asset": {"version": "2.0", "generator": "gsgi"}, "extensionsUsed": [EXTENSION], "scene": 0,
        "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(data)}], "bufferViews": views, "accessors": accessors,
    }  # fmt: skip
    text = json.dumps(root, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
