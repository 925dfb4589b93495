"""Lenses and targets: angles of view, off-axis and mirrored images, strange sizes, and every kind of depth buffer."""

from dataclasses import dataclass
from typing import NamedTuple

import host
import moderngl
import numpy as np
import oracle
import scenes

from gsgi.runtime.camera import Camera, Pinhole
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

from .build import PINHOLE, gaussians, turned
from .case import Case, Tolerance
from .layers import ALL_SETS, clip_from_view
from .over import EVERYWHERE as OVER
from .over import over_case
from .surface import DISTANCE, Reading, surface_case
from .surface import EVERYWHERE as SURFACE
from .surface_gaussians import everywhere, tiles

GROUP = "Projection"
SOFT = "softpipe"
IMAGES = tuple(layer for layer in OVER if layer != "file")
DRAWN = tuple(layer for layer in IMAGES if not layer.startswith("gradient"))
SPARSE = "llvmpipe", "avx512", "double"
READ = tuple(layer for layer in SURFACE if layer != "file")
INSIDE = scenes.inside_camera()


class Lens(NamedTuple):
    """A projection of a host: the element of its third row for z, that for 1, and what its depth buffer holds."""

    z: float
    one: float
    depth: str = "window"
    upper_left: bool = False
    zero_to_one: bool = False
    view_from_world: np.ndarray = np.eye(4)
    last_row: tuple[float, ...] = (0, 0, -1, 0)


@dataclass(frozen=True)
class HostFrame:
    """The tiles on a wall, from a depth buffer as a host's lens writes it. The truth is the oracle's B."""

    lens: Lens

    def error(self, layer: str, gl: moderngl.Context) -> float:
        """The largest error of B, in parts of the largest B. Under an upper left origin row 0 is on top."""
        reading, lens = Reading(tiles(), everywhere()), self.lens
        depth, normal = (array.astype(float)[::-1] for array in reading.seen)
        ndc = -lens.z + lens.one / depth
        stored = {"linear": depth, "window": ndc if lens.zero_to_one else (ndc + 1) / 2, "reversed": ndc}[lens.depth]
        if lens.upper_left:
            stored, normal = stored[::-1], normal[::-1]
        clip = np.diag([2 * PINHOLE.fx / PINHOLE.width, 2 * PINHOLE.fy / PINHOLE.height, 0, 0])
        clip[2, 2:], clip[3] = (lens.z, lens.one), lens.last_row
        light = IndirectLight(gl, Bake(reading.fine, reading.blend, coarse=reading.coarse), _encoding(lens), 1)
        textures = host.texture(gl, stored), host.texture(gl, np.concatenate([normal, normal[..., :1]], axis=2))
        try:
            if lens.upper_left or lens.zero_to_one:
                host.call(gl, "ClipControl", *_clip_control(lens))
            found = host.pixels(light.draw(*textures, lens.view_from_world, clip))[..., :3]
        finally:
            if lens.upper_left or lens.zero_to_one:
                host.call(gl, "ClipControl", host.LOWER_LEFT, host.NEGATIVE_ONE_TO_ONE)
            for resource in (light, *textures):
                resource.release()
        expected = reading.expected[0].reshape(found.shape)
        return float(np.abs((found if lens.upper_left else found[::-1]) - expected).max() / expected.max())


@dataclass(frozen=True)
class HostView:
    """The tiles on a wall, seen through a host's own matrices. The truth is the oracle's B at what they show."""

    clip_from_view: np.ndarray
    view_from_world: np.ndarray

    def error(self, layer: str, gl: moderngl.Context) -> float:
        """The largest error of B, in parts of the largest B."""
        reading, shape = Reading(tiles(), everywhere()), (PINHOLE.height, PINHOLE.width)
        depth = np.full(shape, DISTANCE)
        y, x = ((np.mgrid[: shape[0], : shape[1]] + 0.5) / np.reshape(shape, (2, 1, 1))) * 2 - 1
        clip = self.clip_from_view
        away = depth * -clip[3, 2] + clip[3, 3]  # the homogeneous coordinate
        view = [(c * away + depth * clip[k, 2]) / clip[k, k] for k, c in enumerate((x, y))]
        points = np.stack([*view, -depth, np.ones(shape)], axis=-1) @ np.linalg.inv(self.view_from_world).T
        normal = np.broadcast_to([0.0, 0, 1], (*shape, 3))
        _, expected = oracle.read_surface(
            reading.fine, reading.coarse, reading.blend, points[..., :3].reshape(-1, 3), normal.reshape(-1, 3)
        )
        light = IndirectLight(gl, reading.bake, Encoding("linear", "signed"), 1)
        textures = host.texture(gl, depth), host.texture(gl, np.concatenate([normal, normal[..., :1]], axis=2))
        try:
            found = host.pixels(light.draw(*textures, self.view_from_world, clip))[..., :3]
        finally:
            for resource in (light, *textures):
                resource.release()
        return float(np.abs(found - expected.reshape(found.shape)).max() / expected.max())


@dataclass(frozen=True)
class StateLeft:
    """The tiles on a wall, in a context whose pixel-store state a host has changed, from the upload on."""

    def error(self, layer: str, gl: moderngl.Context) -> float:
        """The largest error of B, in parts of the largest B."""
        reading = Reading(tiles(), everywhere())
        depth, normal = (array.astype(float)[::-1] for array in reading.seen)
        textures = host.texture(gl, depth), host.texture(gl, np.concatenate([normal, normal[..., :1]], axis=2))
        calls = [call for call in host.SET.values() if call[0] == "PixelStorei"]
        light = None
        try:
            for call in calls:
                host.call(gl, *call)
            bake = Bake(reading.fine, reading.blend, coarse=reading.coarse)
            light = IndirectLight(gl, bake, Encoding("linear", "signed"), 1)
            drawn = light.draw(*textures, PINHOLE.view_from_world, clip_from_view(PINHOLE, NEAR))
            for name, parameter, value in calls:  # back to what it is in a fresh context
                host.call(gl, name, parameter, 4 if value == 8 else 0)
            found = host.pixels(drawn)[::-1, :, :3]
        finally:
            for resource in filter(None, (light, *textures)):
                resource.release()
        expected = reading.expected[0].reshape(found.shape)
        return float(np.abs(found - expected).max() / expected.max())


def _encoding(lens: Lens) -> Encoding:
    return Encoding(lens.depth, "signed")


def _clip_control(lens: Lens) -> tuple[int, int]:
    origin = host.UPPER_LEFT if lens.upper_left else host.LOWER_LEFT
    return origin, host.ZERO_TO_ONE if lens.zero_to_one else host.NEGATIVE_ONE_TO_ONE


NEAR, FAR = 0.05, 20.0
TO_FAR = (-(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR))
TO_INFINITY = (-1.0, -2 * NEAR)
HALF_TO_FAR = (-FAR / (FAR - NEAR), -FAR * NEAR / (FAR - NEAR))
REVERSED = (0.0, NEAR)
REVERSED_TO_FAR = (NEAR / (FAR - NEAR), FAR * NEAR / (FAR - NEAR))
_DEPTHS = Tolerance(1e-3, "B is stored in half floats; depths of float32 in a window buffer are off by 1e-5 m")


def lens(name: str, *values, refused: str | None = None, **changes) -> Case:
    """A case of a host's lens; `refused` is what the message of its ValueError names."""
    holds = "refused, naming the matrix" if refused else "the light is the oracle's"
    layers = ("llvmpipe",) if changes or refused else ("llvmpipe", SOFT)
    answer = (ValueError, refused) if refused else None
    return Case(GROUP, name, holds, lambda: HostFrame(Lens(*values, **changes)), dict.fromkeys(layers, _DEPTHS), answer)


def over(name: str, pinhole: Pinhole, layers=IMAGES, **changes) -> Case:
    """A case of fifty Gaussians seen through a pinhole."""
    return over_case(GROUP, name, lambda: oracle.random_gaussians(50, 1, 9), layers, pinhole=pinhole, **changes)


def surface(name: str, pinhole: Pinhole, layers=READ, **changes) -> Case:
    """A case of tiles on a wall seen through a pinhole."""
    return surface_case(GROUP, name, lambda: (tiles(), everywhere()), layers, pinhole=pinhole, **changes)


def of_angle(degrees: float, width: int = 33, height: int = 17) -> Pinhole:
    return Camera(np.eye(4), np.radians(degrees), 0.01).pinhole(width, height)


def inside(width: int, height: int, **changes) -> Pinhole:
    return INSIDE.pinhole(width, height)._replace(**changes)


SIZES = (1, 1), (16, 16), (15, 31), (17, 33), (130, 110), (1, 4096), (4096, 1), (16384, 1)
CLIP, POSE = "^clip_from_view: ", "^view_from_world: "
MIRRORED = PINHOLE._replace(fy=-PINHOLE.fy)
SHIFTED = PINHOLE._replace(fx=30.0, fy=22.0, cx=10.25, cy=13.5)

CASES = [
    over("1 degree", of_angle(1)._replace(view_from_world=INSIDE.view_from_world)),
    over("170 degrees", of_angle(170)._replace(view_from_world=INSIDE.view_from_world)),
    over("off-centre, unequal focal lengths", inside(48, 40, fx=30.0, fy=55.0, cx=10.25, cy=33.5)),
    over("centre far outside the image", inside(48, 40, cx=-12.0, cy=50.0)),
    *[over(f"a target of {width} x {height} px", inside(width, height)) for width, height in SIZES[:4]],
    *[over(f"a target of {width} x {height} px", inside(width, height), DRAWN) for width, height in SIZES[4:]],
    *[
        over_case(GROUP, f"a needle over many tiles at {angle} degrees", lambda angle=angle: gaussians(
            (0.05, 0.02, -1), (0.5, 0.001, 0.001), turned(np.radians(angle)), 0.99),
            DRAWN, pinhole=of_angle(57, 130, 110))
        for angle in (6, 51, 97, 141)
    ],
    over("a mirrored image", PINHOLE._replace(fy=-PINHOLE.fy, view_from_world=INSIDE.view_from_world), ("llvmpipe",)),
    over("a mirrored image in a bake", MIRRORED, ("double", *ALL_SETS), refused=(ValueError, "fx and fy"),
         holds="refused: a bake's cameras mirror nothing"),
    surface("1 degree", of_angle(1), depth=100.0),
    surface("170 degrees", of_angle(170)),
    surface("off-centre, unequal focal lengths", SHIFTED, (*READ, SOFT)),
    surface("a mirrored image", MIRRORED, (*READ, SOFT)),
    surface("a target of 1 x 1 px", of_angle(57, 1, 1)),
    surface("a target of 1 x 512 px", of_angle(57, 1, 512)),
    surface("a target of 16384 x 1 px", PINHOLE._replace(width=16384, height=1, cx=8192.0, cy=0.5, fx=8e3), SPARSE),
    lens("a depth buffer with a far plane", *TO_FAR),
    lens("a depth buffer to infinity", *TO_INFINITY),
    lens("a depth buffer from 0 to 1", *HALF_TO_FAR, zero_to_one=True),
    lens("a depth buffer from 0 to 1 to infinity", -1.0, -NEAR, zero_to_one=True),
    lens("a reversed depth buffer to infinity", *REVERSED, "reversed"),
    lens("a reversed depth buffer with a far plane", *REVERSED_TO_FAR, "reversed"),
    lens("a reversed depth buffer under glClipControl", *REVERSED, "reversed", zero_to_one=True),
    lens("an upper left origin", *TO_FAR, upper_left=True),
    lens("an upper left origin, depth from 0 to 1", *HALF_TO_FAR, upper_left=True, zero_to_one=True),
    lens("an upper left origin, reversed", *REVERSED, "reversed", upper_left=True, zero_to_one=True),
    lens("metres under any projection", *REVERSED, "linear"),
    lens("neither perspective nor orthographic", -0.1, -1.0, last_row=(0, 0, -1, 1), refused=f"{CLIP}a .4, 4. proj"),
    Case(GROUP, "pixel-store state that a host left", "the light is the oracle's", StateLeft,
         dict.fromkeys(("llvmpipe", SOFT), _DEPTHS)),
    Case(GROUP, "an orthographic projection", "the light is the oracle's",
         lambda: HostView(np.diag([0.4, 0.8, -0.1, 1.0]), np.eye(4)), dict.fromkeys(("llvmpipe", SOFT), _DEPTHS)),
    Case(GROUP, "a pose that mirrors", "the light is the oracle's",
         lambda: HostView(clip_from_view(PINHOLE, NEAR), np.diag([-1.0, 1, 1, 1])),
         dict.fromkeys(("llvmpipe", SOFT), _DEPTHS)),
    lens("no near plane", -1.0, 0.0, refused=f"{CLIP}a near plane"),
    lens("a projection that is not a number", np.nan, -0.1, refused=CLIP),
    lens("a pose that scales", *TO_FAR, view_from_world=np.diag([2.0, 2, 2, 1]), refused=f"{POSE}a rigid"),
    lens("a pose that is not a number", *TO_FAR, view_from_world=np.full((4, 4), np.nan), refused=POSE),
    lens("a reversed projection of a plain depth buffer", *REVERSED, refused=f"{CLIP}.*Encoding.depth"),
    lens("a plain projection of a reversed depth buffer", *TO_FAR, "reversed", refused=f"{CLIP}.*Encoding.depth"),
]  # fmt: skip
