"""What a method of storing indirect light is to the study."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    import moderngl

    from gsgi.baker.progress import Progress
    from gsgi.runtime.camera import Camera

    from .gl.frame import Frame
    from .ground import Ground


class LightPass(Protocol):
    """A method's light in one deferred frame: how the G-buffer is filled, and how B is drawn from it."""

    def draw_surfaces(self, camera: "Camera") -> None:
        """Fill the frame's G-buffer for a camera of the frame's own space (see Frame.origin)."""

    def draw_light(self, camera: "Camera") -> "moderngl.Texture":
        """B for the same camera in world space: RGBA16F of the frame's size, valid until the next call."""

    def release(self) -> None:
        """Free the GPU memory."""


class Answer(Protocol):
    """What a method baked: a frozen dataclass of arrays and numbers, so that the cache can keep it."""

    @property
    def file_bytes(self) -> int:
        """Bytes to ship."""

    @property
    def gpu_bytes(self) -> int:
        """Bytes that stay on the GPU, without targets of the frame's size."""

    def at(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
        """B (N, 3) float32 at points (N, 3) float32, m, with unit normals (N, 3) float32, in world space.

        None if the method has no such function, because it answers for whole images only.
        """

    def light_pass(self, frame: "Frame", scale: int) -> "LightPass | None":
        """Its pass in `frame`, which reads the light once per `scale` x `scale` pixels; None if there is no light."""


class Method(NamedTuple):
    """A method of storing or computing B. Its one setting is a number, which the study sweeps.

    `name` is that of the command line, `title` that of the report; `source` is the paper, and `built` says in one
    sentence how it is built here. `swept` names the setting with its unit, and `settings(ground)` lists its values.
    `bake(ground, value, progress)` makes an `answer`, each stage timed by the progress. `scales` are the resolutions of
    its pass: 2 reads the light once per 2 x 2 pixels. `paths` are further numbers of paths, relative to the default's,
    with which the default budget is baked too. `in_space` says whether it lights objects that move.
    """

    name: str
    title: str
    source: str
    built: str
    swept: str
    answer: type
    settings: "Callable[[Ground], Sequence[float]]"
    bake: "Callable[[Ground, float, Progress], Answer]"
    scales: tuple[int, ...] = (1,)
    paths: tuple[float, ...] = ()
    in_space: bool = False

    @property
    def module(self) -> str:
        """Absolute name of the module on which its answers depend."""
        return self.bake.__module__
