"""The study of one scene: every method and setting baked, drawn, compared and timed."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from gsgi.baker.evaluation import held_out
from gsgi.baker.evaluation.comparison import indirect_ceiling
from gsgi.baker.progress import Progress
from gsgi.runtime.errors import SceneError, UnsupportedError

from .ground import Ground
from .leaks import DarkPoints, dark_points
from .measure import ViewScore, free_error, mean_score, score
from .method import Answer, Method
from .path_tracing import TracedImages

if TYPE_CHECKING:
    import moderngl

    from .gl.frame import Frame
    from .gl.timing import FrameTimes

# Pixels of a drawn frame along each pixel of a reference. It is odd, so that one of them has the reference's pixel
# centre for its own; passes of lower resolution then leave out as little of a surface as they do at a screen's size.
MAGNIFIED = 5
ROUNDS, ROUNDS_QUICK = 5, 3
EVERY_QUICK = 2  # frames of one camera in this many are timed


@dataclass(frozen=True)
class Entry:
    """One method with one setting at one resolution of its pass.

    `paths` is their number relative to that of the default; it is 1 but for bakes of ours. `seconds` are of each stage
    of a bake with an empty cache. `free_error` is relative; None if the method has no answer for objects that move, or
    traces them like all others. Milliseconds are the median and the 95th percentile over the cameras: of the whole
    frame, and of what it takes more than the frame without indirect light. `images` (V, H, W, 3) float32 is B in the
    views.
    """

    method: Method
    value: float
    paths: float
    scale: int
    file_bytes: int
    gpu_bytes: int
    seconds: dict[str, float]
    views: tuple[ViewScore, ...]
    free_error: float | None
    frame_ms: float
    frame_ms_p95: float
    more_ms: float
    more_ms_p95: float
    images: np.ndarray

    @property
    def mean(self) -> ViewScore:
        """The mean over the views."""
        return mean_score(self.views)

    @property
    def worst(self) -> ViewScore:
        """The view whose B has the lowest SSIM."""
        return min(self.views, key=lambda view: view.ssim)

    @property
    def bake_seconds(self) -> float:
        """Of all stages."""
        return sum(self.seconds.values())

    @property
    def label(self) -> str:
        """The setting in words."""
        words = f"{self.value:g} {self.method.swept}" if self.method.swept else ""
        words += f", {Fraction(self.paths)} of the paths" if self.paths < 1 else ""
        words += f", {self.paths:g} times the paths" if self.paths > 1 else ""
        return f"{words}, 1/{self.scale} resolution" if self.scale > 1 else words


@dataclass(frozen=True)
class Study:
    """All `entries` of a scene, the ceiling of each view by name, the driver that drew, and the frame's size in px.

    `error_budget` is as `error_budget.error_budget` makes it.
    """

    ground: Ground
    entries: tuple[Entry, ...]
    ceilings: dict[str, float]
    driver: str
    size: tuple[int, int]
    error_budget: dict | None


@dataclass(frozen=True)
class _Baked:
    method: Method
    value: float
    paths: float
    answer: Answer | TracedImages
    seconds: dict[str, float]


def run(ground: Ground, methods: Sequence[Method], size: tuple[int, int]) -> Study:
    """Bake every method with every setting, draw it in all views, and time frames of `size` (width, height) px.

    Raises SceneError if no view tells anything, UnsupportedError without OpenGL.
    """
    references = ground.references
    if not references:
        raise SceneError("no held-out view shows indirect light that is clear of noise: there is nothing to compare")
    ground.warm_up()
    baked = list(_bake_all(ground, methods))
    from gsgi.runtime.gl.context import renderer_string

    from .error_budget import error_budget

    with _context() as ctx:
        driver = renderer_string(ctx)
        entries = _drawn(ground, baked, ctx)
        times = _timed(ground, entries, ctx, size)
        dark = _dark_points(ground, baked)
        finished = tuple(_entry(ground, *entry, times, size, dark) for entry in entries)
        budget = error_budget(ground, finished, ctx)
    ceilings = {name: indirect_ceiling(reference) for name, reference in references.items()}
    return Study(ground, finished, ceilings, driver, size, budget)


def _bake_all(ground: Ground, methods: Sequence[Method]) -> Iterator[_Baked]:
    """Bake what is not in the cache; say how far it is, and how long the rest may take."""
    tasks = [task for method in methods for task in _tasks(ground, method)]
    start = time.perf_counter()
    for done, (method, value, paths) in enumerate(tasks):
        left = (time.perf_counter() - start) / done * (len(tasks) - done) if done else 0.0
        rest = f"; about {left / 60:.0f} min left" if left > 60 else ""
        setting = f", {value:g} {method.swept}" if method.swept else ""
        setting += f", {paths:g} times the paths" if paths != 1 else ""
        Progress(ground.display).say(f"{done + 1}/{len(tasks)} {method.title}{setting}{rest}")
        yield _Baked(method, value, paths, *ground.with_paths(paths).bake(method, value))


def _tasks(ground: Ground, method: Method) -> list[tuple[Method, float, float]]:
    """The method with each of its settings, and with the default budget and other numbers of paths."""
    swept = [(method, value, 1.0) for value in method.settings(ground)]
    return swept + [(method, float(ground.plan.settings.budget), paths) for paths in method.paths]


def _drawn(ground: Ground, baked: Sequence[_Baked], ctx: "moderngl.Context") -> list[tuple[_Baked, int, np.ndarray]]:
    """Each bake at each resolution with B in all views."""
    edge = MAGNIFIED * held_out.SIZE
    drawn = []
    progress = Progress(ground.display)
    with _frame(ground, ctx, (edge, edge)) as frame, progress.stage("views", len(baked), "settings") as advance:
        for each in baked:
            for scale in each.method.scales if each.paths == 1 else each.method.scales[:1]:
                try:
                    drawn.append((each, scale, _images(ground, each.answer, frame, scale)))
                except UnsupportedError as error:
                    progress.warn(f"{each.method.title}, {each.value:g} {each.method.swept}: left out: {error}")
            advance(1)
    return drawn


def _images(ground: Ground, answer: Answer | TracedImages, frame: "Frame", scale: int) -> np.ndarray:
    """B (V, H, W, 3) float32 in the views."""
    if isinstance(answer, TracedImages):
        return answer.images
    light = answer.light_pass(frame, scale)
    if light is None:
        return np.zeros((len(ground.references), held_out.SIZE, held_out.SIZE, 3), np.float32)
    middle = slice(MAGNIFIED // 2, None, MAGNIFIED)
    images = [frame.indirect(ground.cameras[name], light)[middle, middle] for name in ground.references]
    light.release()
    return np.stack(images)


def _timed(ground: Ground, drawn, ctx: "moderngl.Context", size: tuple[int, int]) -> "dict[str, FrameTimes]":
    """Times of the frames of each method's settings, by `_key`, and of the frame without indirect light."""
    from .gl.timing import frame_times

    cameras = [ground.cameras[name] for name in ground.references][:: EVERY_QUICK if ground.quick else 1]
    rounds = ROUNDS_QUICK if ground.quick else ROUNDS
    with _frame(ground, ctx, size) as frame:
        passes = {}
        for each, scale, _ in drawn:
            light = None if isinstance(each.answer, TracedImages) else each.answer.light_pass(frame, scale)
            if light is not None:
                passes[_key(each, scale)] = light
        with Progress(ground.display).stage("frames", len(cameras), "cameras") as advance:
            times = frame_times(frame, cameras, passes, rounds, advance)
        for light in passes.values():
            light.release()
    return times


def _dark_points(ground: Ground, baked: Sequence[_Baked]) -> Sequence[DarkPoints | None]:
    """Those of each reference; None in a study without our default bake."""
    budget = ground.plan.settings.budget
    ours = (each for each in baked if each.method.name == "surface" and each.value == budget and each.paths == 1)
    default = next(ours, None)
    return dark_points(ground, default.answer.bake) if default else [None] * len(ground.references)


def _entry(
    ground: Ground, each: _Baked, scale: int, images: np.ndarray, times: "dict[str, FrameTimes]", size: tuple[int, int],
    dark: Sequence[DarkPoints | None],
) -> Entry:  # fmt: skip
    from .gl.timing import BASE

    frame, more = times.get(_key(each, scale), times[BASE])
    free = None
    if isinstance(each.answer, TracedImages):
        more = each.answer.ms_per_pixel * size[0] * size[1]
        frame = np.median(times[BASE].frame) + more
    elif each.method.in_space:
        free = free_error(each.answer, ground.free_light)
    views = tuple(
        score(name, image, reference, ground.tone_scale, points)
        for image, (name, reference), points in zip(images, ground.references.items(), dark, strict=True)
    )
    numbers = [float(f(ms)) for ms in (frame, more) for f in (np.median, lambda x: np.percentile(x, 95))]
    sizes = each.answer.file_bytes, each.answer.gpu_bytes
    return Entry(each.method, each.value, each.paths, scale, *sizes, each.seconds, views, free, *numbers, images)


def _key(each: _Baked, scale: int) -> str:
    return f"{each.method.name} {each.value:g} {each.paths:g} {scale}"


@contextmanager
def _context() -> "Iterator[moderngl.Context]":
    from gsgi.runtime.gl.context import create_context

    ctx = create_context()
    try:
        yield ctx
    finally:
        ctx.release()


@contextmanager
def _frame(ground: Ground, ctx: "moderngl.Context", size: tuple[int, int]) -> "Iterator[Frame]":
    from .gl.frame import Frame

    frame = Frame(ctx, ground.scene, size)
    try:
        yield frame
    finally:
        frame.release()
