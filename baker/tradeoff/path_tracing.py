"""Path tracing of every frame: the cost of the truth, as it comes and denoised."""

import time
from dataclasses import dataclass

import numpy as np

from gsgi.baker.progress import Progress
from gsgi.baker.trace import denoise
from gsgi.baker.trace.tracer import LAUNCH_POINTS

from .ground import Ground
from .method import Method

SAMPLES = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)
SAMPLES_QUICK = (1, 4, 16, 64, 256)
SEED = 5000
TILES = 6  # views along the edge of the image for which the denoiser is timed: a small one costs more per pixel


@dataclass(frozen=True)
class TracedImages:
    """B in every view, images (V, H, W, 3) float32, and the milliseconds that each took (V,) float64."""

    images: np.ndarray
    ms: np.ndarray
    file_bytes: int = 0
    gpu_bytes: int = 0

    @property
    def ms_per_pixel(self) -> np.ndarray:
        """Milliseconds (V,) of a pixel of each view."""
        return self.ms / (self.images.shape[1] * self.images.shape[2])


def trace_frames(ground: Ground, value: float, progress: Progress) -> TracedImages:
    """Trace every view with `value` paths per pixel, from its surfaces on, as a deferred renderer with rays does."""
    from gsgi.baker.trace import paths

    tracer, images, times = ground.cold.tracer, [], []
    for index, reference in enumerate(ground.references.values()):
        surface = reference.surface
        points = surface.shading_points()
        start = time.perf_counter()
        light = np.zeros((len(points[0]), 3))
        for first in range(0, len(light), LAUNCH_POINTS):
            part = [np.zeros((LAUNCH_POINTS, 3), np.float32) for _ in points]
            for padded, array in zip(part, points, strict=True):
                padded[: len(array[first : first + LAUNCH_POINTS])] = array[first : first + LAUNCH_POINTS]
            count = len(light[first : first + LAUNCH_POINTS])
            numbers = np.zeros((LAUNCH_POINTS, 2), np.uint32)
            numbers[:, 0] = np.arange(first, first + LAUNCH_POINTS)
            sums = paths.indirect(tracer, *part, numbers, int(value), ground.plan.settings.bounces, SEED + 97 * index)
            used = np.maximum(int(value) - sums.invalid[:count], 1)[:, None]
            light[first : first + LAUNCH_POINTS] = sums.light[:count] / used
        times.append(1e3 * (time.perf_counter() - start))
        images.append(surface.image(light.astype(np.float32)))
    return TracedImages(np.stack(images), np.array(times))


def denoise_frames(ground: Ground, value: float, progress: Progress) -> TracedImages:
    """Denoise the same frames with Open Image Denoise, guided by the G-buffer's normals."""
    noisy, _ = ground.bake(PLAIN, value)
    references = list(ground.references.values())
    images = [
        denoise.denoise(image, reference.surface.normal, reference.valid)
        for image, reference in zip(noisy.images, references, strict=True)
    ]
    normal = references[0].surface.normal
    denoiser, _ = ground.timed("denoiser", Denoiser, lambda progress: _timed_denoiser(normal), __name__)
    return TracedImages(np.stack(images), noisy.ms + denoiser.ms_per_pixel * normal[..., 0].size)


@dataclass(frozen=True)
class Denoiser:
    """What the denoiser takes for a pixel of a frame, ms."""

    ms_per_pixel: float


def _timed_denoiser(normal: np.ndarray) -> Denoiser:
    """Its time for a frame of TILES x TILES views with these normals (H, W, 3): the fastest of three runs."""
    import mitsuba_oidn

    guide = np.ascontiguousarray(np.tile(normal, (TILES, TILES, 1)), np.float32)
    white, taken = np.ones_like(guide), []
    for _ in range(4):
        start = time.perf_counter()
        mitsuba_oidn.denoise(white, white, guide, hdr=True, clean_aux=True, input_scale=1.0)
        taken.append(1e3 * (time.perf_counter() - start))
    return Denoiser(min(taken[1:]) / guide[..., 0].size)


def samples(ground: Ground) -> list[float]:
    """Paths per pixel."""
    return [float(count) for count in (SAMPLES_QUICK if ground.quick else SAMPLES)]


def samples_denoised(ground: Ground) -> list[float]:
    """The same; none without the denoiser."""
    return samples(ground) if denoise.available() else []


PLAIN = Method(
    "path-tracing", "path tracing", "Kajiya 1986",
    "This project's tracer on the processor; time of its own views, scaled to the frame's number of pixels.",
    "paths per pixel", TracedImages, samples, trace_frames, in_space=True,
)  # fmt: skip
DENOISED = Method(
    "path-tracing-denoised", "path tracing, denoised", "Kajiya 1986; Intel Open Image Denoise",
    "The same, denoised with normals; on the processor too.", "paths per pixel", TracedImages, samples_denoised,
    denoise_frames, in_space=True,
)  # fmt: skip
