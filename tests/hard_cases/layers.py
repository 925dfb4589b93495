"""What several questions need of a layer."""

from collections.abc import Iterator
from contextlib import contextmanager

import moderngl
import numpy as np

from gsgi.baker.native import kernels
from gsgi.runtime.camera import Pinhole
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

INSTRUCTION_SETS = tuple(kernels.instruction_sets())  # of this machine; a case is listed for all of ALL_SETS
ALL_SETS = "scalar", "avx2", "avx512"


@contextmanager
def instruction_set(name: str) -> Iterator[None]:
    """Run the kernels with one instruction set."""
    kernels.set_instruction_set(name)
    try:
        yield
    finally:
        kernels.set_instruction_set(INSTRUCTION_SETS[-1])


def clip_from_view(pinhole: Pinhole, near: float, far: float = np.inf) -> np.ndarray:
    """OpenGL projection (4, 4) of a pinhole."""
    p = pinhole
    z, one = (-1.0, -2 * near) if np.isinf(far) else ((far + near) / (near - far), 2 * far * near / (near - far))
    return np.array(
        [
            [2 * p.fx / p.width, 0, 1 - 2 * p.cx / p.width, 0],
            [0, 2 * p.fy / p.height, 2 * p.cy / p.height - 1, 0],
            [0, 0, z, one],
            [0, 0, -1, 0],
        ]
    )


def drawn_by_gl(
    gl: moderngl.Context, bake: Bake, pinhole: Pinhole, near: float, depth: np.ndarray, normal: np.ndarray, scale=1
) -> np.ndarray:
    """RGBA (H, W, 4) float64 of the indirect light, row 0 on top, as a host gets it.

    `depth` (H, W), m; `normal` (H, W, 3).
    """
    size = pinhole.width, pinhole.height
    texels = np.concatenate([normal, np.zeros_like(normal[..., :1])], axis=2)[::-1].astype("f4").tobytes()
    depths = gl.texture(size, 1, depth[::-1].astype("f4").tobytes(), dtype="f4")
    normals = gl.texture(size, 4, texels, dtype="f4")
    light = IndirectLight(gl, bake, Encoding(normal="signed"), scale)
    try:
        drawn = light.draw(depths, normals, pinhole.view_from_world, clip_from_view(pinhole, near))
        return np.frombuffer(drawn.read(), drawn.dtype).reshape(*size[::-1], 4)[::-1].astype(float)
    finally:
        for resource in (light, depths, normals):
            resource.release()
