"""The coarse level: Gaussians throughout free space, so that every point has light, also one on a moving object."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gsgi.baker.fitting.blue_noise import drawn, levelled, spacing, thin
from gsgi.baker.trace.local_light import TOGETHER, Blocks, LocalLight, free_blocks
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .budget import COARSE_DEGREE
from .cuts import cut_where_better
from .occlusion import Occlusion
from .optimiser import LIST_STEPS, SurfaceOptimiser
from .rounding import rounded_in_turns
from .samples import SurfaceSamples
from .state import SurfaceState
from .turns import Turns

CANDIDATES = 16  # points in free space per Gaussian, from which an evenly spread subset is chosen
WIDTH = 0.6  # standard deviation, relative to the mean distance to the three nearest

# Step sizes of the shapes, as in fit.RATES; the colours are solved for every SOLVE_STEPS steps, by few iterations,
# and at the end. With 60 steps, a solution every six and RIDGE of the fine level, the squared error of samples that
# were held back was 1.1 to 1.4 times as large in six bakes.
RATES = {"place": 0.06, "turn": 0.04, "log_scale": 0.06, "logit_opacity": 0.05, "colour": 0.0, "slope": 0.0}
RATE_END = 0.1
STEPS, SOLVE_STEPS, SOLVE_ITERATIONS = 120, 4, 6

# From these shares of the steps on, every how many-th sample counts, in turns of so many steps (see Turns). In half of
# the places of a hall, things that move were off by 1.05 times as much, and beside a sealed room by 0.95 times, for two
# thirds of the time; in the hall by 1.1 times with a quarter throughout.
PARTS, TURN_STEPS = {0.0: 4, 1 / 3: 2, 2 / 3: 1}, 2 * LIST_STEPS

# Share of the Gaussians at the start, and the steps after which the others follow where the light is wrong: in a small
# room among large ones, in a niche, around a lamp. With all of them spread evenly at the start, the error of a tenth of
# the places was 1.14 to 2.7 times as large in four scenes, and the median 1.01 to 1.15 times.
START_SHARE, GROWN_AFTER = 1 / 2, 40

# How strongly colours are held to the mean of the light that a Gaussian sees. That of the fine level is too much for
# light that differs so much by the normal.
RIDGE = 3e-3

# One Gaussian of almost no weight reaches every point of the scene and far beyond. Its scale is relative to the
# diagonal of the samples' bounding box.
EVERYWHERE_SCALE, EVERYWHERE_OPACITY = 1.0, 1 / 255
OPACITY = 0.5  # of the others at the start
SCALE_MIN = 1e-6  # m; points can coincide

# Where the noise of samples is more than NOISY of the light around them, a share HELD_BACK of them tells how many
# Gaussians it supports, after TRIED steps: half as many, as long as that raises their error by less than WORTH. Down to
# a share FEWEST: where even all Gaussians cannot follow the light, their number hardly changes the error.
NOISY, HELD_BACK, TRIED, WORTH, FEWEST = 0.25, 1 / 4, 12, 1.05, 1 / 4


def coarse_level(
    samples: SurfaceSamples, count: int, blend: SurfaceBlend, seed: int, triangles: Triangles | None = None
) -> Gaussians:
    """Fit at most `count` Gaussians to `samples` in free space, whose normals have all directions.

    Where samples are noisy there may be fewer, which follow less of the noise. With the `triangles` of the scene,
    Gaussians are cut where they would carry light across an occluder: before their first steps, so that these fit what
    the cuts leave, and at the end.
    """
    count = supported(samples, count, blend, seed)
    first = _evenly_apart(samples.position, max(round(START_SHARE * count), 1), np.random.default_rng(seed))
    around = _around(samples)
    turns = Turns(PARTS, STEPS, TURN_STEPS, lambda part: coarse_optimiser(samples[part], first, blend, around.at(part)))
    occlusion = Occlusion(samples, triangles, turns.at(0).blend, count) if triangles else None
    state = _stepped(turns.at, _cut(SurfaceState.fresh(first), turns.at(0), occlusion), 0, GROWN_AFTER)
    room, some, optimiser = min(count, 1 + len(samples)) - len(state), turns.part(GROWN_AFTER), turns.at(GROWN_AFTER)
    more = _where_wrong(samples[some], room, optimiser, state.gaussians, np.random.default_rng([seed, 1]))
    state = _stepped(turns.at, _cut(state.joined(more), optimiser, occlusion), GROWN_AFTER, STEPS)
    return _lit(state.gaussians, turns.whole, occlusion)


def _cut(state: SurfaceState, optimiser: SurfaceOptimiser, occlusion: Occlusion | None) -> SurfaceState:
    """The state with all Gaussians but the first cut at occluders, if they are known."""
    return state.cut(*cut_where_better(state.gaussians, optimiser, occlusion, spared=1)) if occlusion else state


def _stepped(at: Callable[[int], SurfaceOptimiser], state: SurfaceState, first: int, end: int) -> SurfaceState:
    """The state after the steps from `first` on, before the step `end`, each by the optimiser `at` it."""
    for step in range(first, end, SOLVE_STEPS):
        state = coarse_steps(at(step), state, step)
    return state


def _where_wrong(
    samples: SurfaceSamples, room: int, optimiser: SurfaceOptimiser, gaussians: Gaussians, rng: np.random.Generator
) -> Gaussians:
    """At most `room` black Gaussians, as dense as samples times the noise-free RMS error around them.

    By its square instead, they were too dense in few places: the error of a tenth of the places of a room beside a
    bright one was twice as large.
    """
    blocks = Blocks(free_blocks(samples.position).number // TOGETHER)
    error = np.sqrt(np.maximum(*blocks.means(optimiser.error(gaussians)), 0))[blocks.number]
    centres = _apart(samples.position[drawn(error, CANDIDATES * room, rng)], room, rng)
    return _round(centres, WIDTH * spacing(np.concatenate([centres, gaussians.position[1:]]))[: len(centres)])


def supported(samples: SurfaceSamples, count: int, blend: SurfaceBlend, seed: int) -> int:
    """How many of `count` Gaussians the light of noisy `samples` is worth: with more they would follow the noise."""
    around = _around(samples)
    if len(samples) <= count or np.median(around.noise / around.level) <= NOISY:
        return count
    held = np.random.default_rng(seed).random(len(samples)) < HELD_BACK

    def error(count: int) -> float:
        """That of so many Gaussians at the samples that are held back, free of noise."""
        optimiser, state = coarse_start(samples[~held], count, blend, seed)
        level = optimiser.solve(_stepped(lambda _: optimiser, state, 0, TRIED).gaussians)
        return float(coarse_optimiser(samples[held], level, blend).error(level).mean())

    least, fewest = error(count), max(FEWEST * count, 1)
    while count // 2 >= fewest and (found := error(count // 2)) < WORTH * least:
        count, least = count // 2, min(found, least)
    return count


def coarse_start(
    samples: SurfaceSamples, count: int, blend: SurfaceBlend, seed: int
) -> tuple[SurfaceOptimiser, SurfaceState]:
    """What a fit of so many Gaussians to all samples begins with."""
    gaussians = _evenly_apart(samples.position, count, np.random.default_rng(seed))
    return coarse_optimiser(samples, gaussians, blend), SurfaceState.fresh(gaussians)


def coarse_steps(optimiser: SurfaceOptimiser, state: SurfaceState, first: int) -> SurfaceState:
    """Solve for the colours, then take SOLVE_STEPS steps, of which the first has the number `first`."""
    between = first % TURN_STEPS != 0
    state = replace(state, gaussians=optimiser.solve(state.gaussians, SOLVE_ITERATIONS, between))
    for step in range(first, first + SOLVE_STEPS):
        before, falling = state.gaussians, RATE_END ** (step / STEPS)
        state, _ = optimiser.step(state, {name: falling * rate for name, rate in RATES.items()}, step + 1)
        state = replace(state, gaussians=_everywhere_again(state.gaussians, before))
    return state


def coarse_again(
    samples: SurfaceSamples, before: Gaussians, blend: SurfaceBlend, triangles: Triangles | None = None
) -> Gaussians:
    """The coarse level `before` an edit with the light of other `samples`, cut where occluders are now."""
    optimiser = coarse_optimiser(samples, before, blend)
    return _lit(before, optimiser, Occlusion(samples, triangles, optimiser.blend, len(before)) if triangles else None)


def _lit(gaussians: Gaussians, optimiser: SurfaceOptimiser, occlusion: Occlusion | None) -> Gaussians:
    """The Gaussians, all but the first cut for the last time, with the light of the optimiser's samples.

    All is rounded as in the file: where a dim Gaussian ends, one a thousand times as bright may begin; before a lamp,
    light from all other sides is smaller than a step. Surfaces that need better get Gaussians of the fine level.
    """
    cut = cut_where_better(gaussians, optimiser, occlusion, spared=1)[0] if occlusion else gaussians
    lit = optimiser.solve(codec.stored_shapes(cut, fine=False))
    return rounded_in_turns(lit, optimiser, lambda level: codec.stored_level(level, fine=False))


def coarse_optimiser(
    samples: SurfaceSamples, gaussians: Gaussians, blend: SurfaceBlend, around: LocalLight | None = None
) -> SurfaceOptimiser:
    """The optimiser of coarse Gaussians against `samples` in free space; by default the light around them is theirs."""
    nothing = SurfaceState.fresh(gaussians).keep(np.zeros(len(gaussians), bool)).gaussians
    return SurfaceOptimiser(samples, nothing, replace(blend, sharpness=0, floor=0.0), around or _around(samples), RIDGE)


def _around(samples: SurfaceSamples) -> LocalLight:
    """The light around samples in free space."""
    return free_blocks(samples.position).light(samples.indirect_a, samples.indirect_b, sure=True)


def _everywhere_again(moved: Gaussians, start: Gaussians) -> Gaussians:
    """Reset the shape of the first Gaussian to `start`: no sample shows that it is needed beyond the samples."""
    shape = "position", "rotation", "scale", "opacity"
    return replace(moved, **{k: np.concatenate([getattr(start, k)[:1], getattr(moved, k)[1:]]) for k in shape})


def _evenly_apart(position: np.ndarray, count: int, rng: np.random.Generator) -> Gaussians:
    """At most `count` black Gaussians evenly spread over points (S, 3); the first one covers everything."""
    if not len(position):
        return Gaussians(*(np.empty((0, *shape), np.float32) for shape in ((3,), (4,), (3,), (), (9, 3))))
    candidates = position[np.sort(rng.permutation(len(position))[: CANDIDATES * count])]
    centres, low, high = _apart(candidates, count - 1, rng), position.min(axis=0), position.max(axis=0)
    everywhere = _round((low + high)[None] / 2, EVERYWHERE_SCALE * np.linalg.norm(high - low)[None], EVERYWHERE_OPACITY)
    both = zip(vars(everywhere).values(), vars(_round(centres, WIDTH * spacing(centres))).values(), strict=True)
    return Gaussians(*map(np.concatenate, both))


def _apart(candidates: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """At most `count` of the points (P, 3), evenly spread."""
    upwards = np.tile(np.float32([0, 0, 1]), (len(candidates), 1))
    return candidates[thin(levelled(candidates), upwards, count, rng)]


def _round(position: np.ndarray, scale: np.ndarray, opacity: float = OPACITY) -> Gaussians:
    """Black Gaussians at positions (N, 3), m, with standard deviations (N,), m."""
    n = len(position)
    return Gaussians(
        position.astype(np.float32),
        np.tile(np.float32([0, 0, 0, 1]), (n, 1)),
        np.repeat(np.maximum(scale, SCALE_MIN)[:, None], 3, axis=1).astype(np.float32),
        np.full(n, opacity, np.float32),
        np.zeros((n, (COARSE_DEGREE + 1) ** 2, 3), np.float32),
    )
