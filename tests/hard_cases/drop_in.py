"""The drop-in for pyrender: vertex colours under baked light, with every flag."""

from dataclasses import dataclass

import moderngl
import numpy as np
import pytest
from gsgi_files import constant
from scipy.ndimage import maximum_filter

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.pyrender.flags import NORMALS, RenderFlags
from gsgi.runtime.pyrender.frame import FrameRenderer

from .case import Case, Tolerance

SIZE = 24, 16
AWAY = 2.0  # m, of the wall that fills the view
YFOV = 0.8
B = np.array([0.2, 0.3, 0.4])
BASE = np.array([0.9, 0.6, 0.3])
MIDDLE, ACROSS, UPWARD = np.array([[0.5, 0.6, 0.4], [0.2, -0.3, 0.1], [-0.1, 0.2, 0.3]])  # colours: affine in x and y
GAMMA = 2.2
SHOWN = 200.0, 100.0, 50.0  # of the wall's node with SEG
WIRES = RenderFlags.ALL_WIREFRAME | RenderFlags.FLIP_WIREFRAME
LEVELS = Tolerance(1, "8 bits are rounded by half a level, and a B in half floats moves by less")


def color_at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Vertex colour (..., 3) of the wall at x and y, m."""
    return MIDDLE + x[..., None] * ACROSS / 2 + y[..., None] * UPWARD / 2


@dataclass(frozen=True)
class ColoredWall:
    """A wall that fills the view, with vertex colours, under a B that is the same everywhere and no other light.

    Lines get no baked light; they are under ambient light of the same radiance.
    """

    flags: RenderFlags

    @property
    def wires(self) -> bool:
        return bool(self.flags & WIRES)

    def error(self, layer: str, gl: moderngl.Context) -> float:
        """The largest error of a colour in levels of 255, or of the depth in 1e-5 of it."""
        try:
            import pyrender
        except Exception as error:  # it imports pyglet and OpenGL, which can raise anything
            pytest.skip(f"pyrender: {error}")
        corners = np.array([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]])
        colors = np.column_stack([color_at(*corners[:, :2].T), np.ones(4)])
        material = pyrender.MetallicRoughnessMaterial(baseColorFactor=(*BASE, 1), metallicFactor=0.0)
        wall = pyrender.Primitive(
            corners,
            normals=np.tile([0, 0, 1.0], (4, 1)),
            indices=[[0, 1, 2], [0, 2, 3]],
            color_0=colors,
            material=material,
        )
        scene = pyrender.Scene(bg_color=(0, 0, 0, 1), ambient_light=B if self.wires else (0, 0, 0))
        node = scene.add(pyrender.Mesh([wall]))
        pose = np.eye(4)
        pose[2, 3] = AWAY
        scene.add(pyrender.PerspectiveCamera(YFOV, znear=0.1), pose=pose)
        frame = FrameRenderer(gl, constant(B))
        try:
            lens = frame.render(scene, self.flags, SIZE, 1.0, {node: np.array(SHOWN) / 255})
            if self.flags & RenderFlags.DEPTH_ONLY:
                return float(np.abs(frame.depth(lens) / AWAY - 1).max() / 1e-5)
            found = frame.color(3).astype(float)
        finally:
            frame.release()
            gl.wireframe = False
        expected = self.expected()
        if self.wires:  # which cover a pixel in part, anywhere in it
            assert found.any(), "lines are seen"
            return float((found - maximum_filter(expected, (3, 3, 1))).max())
        return float(np.abs(found - expected).max())

    def expected(self) -> np.ndarray:
        """Colours (H, W, 3), 0 to 255, row 0 on top."""
        if self.flags & RenderFlags.SEG:
            return np.broadcast_to(SHOWN, (SIZE[1], SIZE[0], 3))
        metres = 2 * AWAY * np.tan(YFOV / 2) / SIZE[1]
        y, x = metres * (np.mgrid[: SIZE[1], : SIZE[0]] + 0.5 - np.reshape(SIZE[::-1], (2, 1, 1)) / 2)
        color = BASE * color_at(x, -y)
        return 255 * (color if self.flags & RenderFlags.FLAT else (color * B) ** (1 / GAMMA))


def case(flag: RenderFlags) -> Case:
    unsupported = (UnsupportedError, "are not supported") if flag & NORMALS else None
    holds = "refused, naming the flags" if unsupported else "colour * base colour * B, as the flag shows it"
    return Case("Drop-in for pyrender", f"vertex colours, {flag.name}", holds, lambda: ColoredWall(flag),
                {"drop-in": LEVELS}, unsupported)  # fmt: skip


CASES = [case(flag) for flag in RenderFlags.__members__.values()]
