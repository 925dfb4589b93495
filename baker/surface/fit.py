"""Fits Gaussians of the `surface` operator to samples of B.

Shapes and colours follow the gradient. Colours are also solved for by least squares, every few steps and whenever the
number of Gaussians changes: shapes then follow the error that is left with the best light for them, as in variable
projection (Golub and Pereyra 1973). Adam alone leaves some light where there is none.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gsgi.baker.cache.checkpoint import Checkpoint
from gsgi.baker.cache.records import from_arrays, to_arrays
from gsgi.baker.fitting.blue_noise import CANDIDATES, drawn, levelled, spacing, thin
from gsgi.baker.fitting.rotations import rotation_to
from gsgi.baker.fitting.schedule import Schedule, count_after
from gsgi.baker.fitting.task import Monitor
from gsgi.baker.trace.point_order import coherent
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime import constants
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Gaussians, SurfaceBlend

from .cuts import cut_where_better
from .occlusion import Occlusion, seen_light
from .optimiser import LIST_STEPS, SurfaceOptimiser
from .samples import SurfaceSamples, joined
from .smoothing import smoothed
from .state import SurfaceState, to_merge, to_remove
from .turns import Turns

# Step sizes of Adam: lengths in standard deviations, turns in rad, colour in units of the level around. They decay
# exponentially to RATE_END times these values.
RATES = {"place": 0.12, "turn": 0.08, "log_scale": 0.12, "logit_opacity": 0.1, "colour": 0.06, "slope": 0.06}
RATE_END = 0.1

# Steps from one solution for the colours to the next. With none but where the number of Gaussians changes, and rates
# half as large, a Cornell box took twice the Gaussians for the same error. With 20 instead of 10, small things gained
# less, and the fit took a tenth less time.
SOLVED_EVERY = LIST_STEPS

# When the number of Gaussians changes, as shares of the steps, with the share of the growth that is done then; and the
# share of the budget at the start. The last change fills holes that Gaussians have left as they moved: without it, one
# of ten fits of a hall had a dark spot on a ceiling.
GROWTH = {0.2: 1 / 3, 0.35: 2 / 3, 0.5: 1.0, 0.75: 1.0}
START_SHARE = 0.5

# From these shares of the steps on, every how many-th sample counts, in turns from one listing to the next (see Turns).
# Frames of a hall, of Sponza and of rooms with gaps were as near to path tracing as with all samples throughout. With a
# quarter at first, and half up to three quarters of the steps, Sponza lost 0.0005 of SSIM. Whatever changes the number
# of Gaussians or cuts them looks at all samples: with parts, light leaked into a sealed room.
PARTS = {0.0: 2, 0.5: 1}

# Standard deviations at the start, in the surface and along its normal, relative to the mean distance to the three
# nearest. Neighbours overlap. Thicker ones would cover the free space in front of the surface, which the coarse level
# represents better.
WIDTH, THICKNESS = 1.3, 0.5
OPACITY = 0.5
SPACING_MIN = 1e-6  # m; points can coincide

# Shapes are stepped as if the coarse level filled in below so many times the file's floor. What samples in free space
# want keeps the weights of the fine level low, and between samples they fall a little: there the coarse level, which is
# several times too bright under a sunlit roof, showed through as spots. Twice a floor of 0.15 made them rarer still in
# one room, but blurred a hall.
STEPPED_FLOOR = 1.5

BADLY_FITTED = 4  # least samples with errors for each Gaussian that is added among them


@dataclass(frozen=True)
class _Run:
    """Everything that the rest of a fit depends on, after `iteration` steps, a multiple of LIST_STEPS."""

    state: SurfaceState
    iteration: int


def fit_surface(
    surface: SurfaceSamples,
    free: SurfaceSamples,
    coarse: Gaussians,
    blend: SurfaceBlend,
    schedule: Schedule,
    monitor: Monitor | None = None,
    checkpoint: Checkpoint | None = None,
    triangles: Triangles | None = None,
) -> Gaussians:
    """Fit the fine level: at most `schedule.budget` Gaussians that match the samples on top of `coarse`.

    They have SH of degree 0 and slopes, and relief where normal maps bend the samples' normals. With the `triangles` of
    the scene, they are cut where they would carry light across an occluder. `monitor(iteration, loss, gaussians)` is
    called after each step, and gaussians() returns the result of that step. The fit resumes from `checkpoint` if that
    holds a state, and saves states there. For a given seed the result does not depend on the number of threads or on
    interruptions. Raises FloatingPointError at the first gradient or loss that is not finite, and names the iteration
    and, for a gradient, the Gaussian.
    """
    rng = np.random.default_rng(schedule.seed)
    surface, samples, against, occlusion = _tools(surface, free, coarse, blend, schedule.budget, triangles)
    turns = Turns(PARTS, schedule.iterations, LIST_STEPS, against)
    if checkpoint and (arrays := checkpoint.load()):
        run = from_arrays(_Run, arrays)
    else:
        first = as_bumpy_as(samples, start(surface, round(START_SHARE * schedule.budget), rng))
        lit = cut_where_better(first, turns.whole, occlusion)[0] if occlusion else turns.whole.solve(first)
        run = _Run(SurfaceState.fresh(lit), 0)
    state = run.state
    changes = {round(share * schedule.iterations): grown for share, grown in GROWTH.items()}
    for iteration in range(run.iteration, schedule.iterations):
        optimiser = turns.at(iteration)
        if iteration in changes and iteration > 0:
            limit = count_after(round(START_SHARE * schedule.budget), schedule.budget, changes[iteration])
            rng = np.random.default_rng([schedule.seed, iteration])
            state = changed(state, limit, turns.whole, surface, rng, occlusion)
            optimiser.exchanged()
        elif iteration % SOLVED_EVERY == 0 and iteration > 0:
            state = replace(state, gaussians=optimiser.solve(state.gaussians))
        state = _stepped(state, optimiser, RATE_END ** (iteration / schedule.iterations), iteration, monitor)
        if checkpoint and (iteration + 1) % LIST_STEPS == 0 and checkpoint.due():
            checkpoint.save(to_arrays(_Run(state, iteration + 1)))
    return finished(state.gaussians, turns.whole, occlusion, blend)


def fit_again(
    surface: SurfaceSamples,
    free: SurfaceSamples,
    coarse: Gaussians,
    blend: SurfaceBlend,
    schedule: Schedule,
    before: Gaussians,
    monitor: Monitor | None = None,
    checkpoint: Checkpoint | None = None,
    triangles: Triangles | None = None,
) -> Gaussians:
    """Fit the fine level of a scene after an edit: the Gaussians `before` it, as the samples now want them.

    Those that hardly any sample sees now make room for others where the light is badly fitted. The schedule's steps
    follow, at the last rates, then a cut at occluders. It takes too little time for a checkpoint. The rest is as in
    `fit_surface`.
    """
    surface, samples, against, occlusion = _tools(surface, free, coarse, blend, schedule.budget, triangles)
    optimiser = against(slice(None))
    state = SurfaceState.fresh(optimiser.solve(as_bumpy_as(samples, before)))
    state = changed(state, schedule.budget, optimiser, surface, np.random.default_rng(schedule.seed))
    for iteration in range(schedule.iterations):
        state = _stepped(state, optimiser, RATE_END, iteration, monitor)
    return finished(state.gaussians, optimiser, occlusion, blend)


def _tools(
    surface: SurfaceSamples,
    free: SurfaceSamples,
    coarse: Gaussians,
    blend: SurfaceBlend,
    budget: int,
    triangles: Triangles | None,
) -> tuple[SurfaceSamples, SurfaceSamples, Callable[[slice], SurfaceOptimiser], Occlusion | None]:
    """The samples of the `surface`, sorted and smoothed where they are noisy, these with those in `free` space, what
    makes the optimiser against a slice of all, and what cuts Gaussians at occluders.

    The importance of samples follows the noise in which they were traced: smooth as it may be made, light that was
    noisy is worth fewer Gaussians. Those of the surface are sorted: neighbours are looked for, and averaged, faster.
    """
    surface = surface[coherent(surface.position, surface.normal)]
    if triangles:
        around = seen_light(surface, free, triangles)
    else:
        traced = joined([surface, free])
        around = traced.blocks.light(traced.indirect_a, traced.indirect_b)
    surface = smoothed(surface, around.at(slice(len(surface))))
    samples = joined([surface, free])
    occlusion = Occlusion(surface, triangles, blend, budget) if triangles else None
    stepped = replace(blend, floor=STEPPED_FLOOR * blend.floor)

    def against(part: slice) -> SurfaceOptimiser:
        return SurfaceOptimiser(samples[part], coarse, stepped, around.at(part))

    return surface, samples, against, occlusion


def as_bumpy_as(samples: SurfaceSamples, gaussians: Gaussians) -> Gaussians:
    """The Gaussians, with relief if normal maps bend the samples' normals, and else without; new relief is flat."""
    if samples.bumpy == gaussians.bumpy:
        return gaussians
    return replace(gaussians, relief=np.zeros((len(gaussians), 3, 3), np.float32) if samples.bumpy else None)


def _stepped(
    state: SurfaceState, optimiser: SurfaceOptimiser, falling: float, iteration: int, monitor: Monitor | None
) -> SurfaceState:
    """The state after a step at `falling` times the RATES. Raises FloatingPointError with the number of the step."""
    try:
        state, loss = optimiser.step(state, {name: falling * rate for name, rate in RATES.items()}, iteration + 1)
    except FloatingPointError as broken:
        raise FloatingPointError(f"{broken} at iteration {iteration}") from broken
    if monitor:
        monitor(iteration + 1, loss, lambda gaussians=state.gaussians: gaussians)
    return state


def finished(
    gaussians: Gaussians, optimiser: SurfaceOptimiser, occlusion: Occlusion | None, blend: SurfaceBlend
) -> Gaussians:
    """The Gaussians, cut for the last time, in the best light as the file's `blend` reads them; without those that no
    sample sees."""
    last = cut_where_better(gaussians, optimiser, occlusion)[0] if occlusion else gaussians
    seen = ~to_remove(optimiser.share(last))  # a cut may leave some that lie between samples, as good as unknown
    optimiser.blend = blend
    return in_best_light(Gaussians(*(column[seen] for column in vars(last).values())), optimiser)


def in_best_light(
    gaussians: Gaussians, optimiser: SurfaceOptimiser, fixed: np.ndarray | None = None
) -> Gaussians:  # fmt: skip
    """The Gaussians with shapes as the file has them, and the best light for these; `fixed` (N,) bool keep theirs."""
    return optimiser.solve(codec.stored_shapes(gaussians), fixed=fixed)


def start(samples: SurfaceSamples, count: int, rng: np.random.Generator, beside: Gaussians | None = None) -> Gaussians:
    """At most `count` Gaussians, as dense as the samples and flat along the normal, which is their +z axis.

    They are as wide as they lie apart from each other and from those `beside` them, and have relief if those have.
    """
    chosen = np.sort(rng.permutation(len(samples))[: CANDIDATES * count])
    position, normal = samples.position[chosen], samples.normal[chosen]
    even = thin(levelled(position), normal, count, rng)
    position, normal, light = position[even], normal[even], samples.indirect[chosen][even]
    centres = position if beside is None else np.concatenate([position, beside.position])
    apart = np.maximum(spacing(centres)[: len(position)], np.float32(SPACING_MIN))
    scale = apart[:, None] * np.array([WIDTH, WIDTH, THICKNESS], np.float32)
    opacity = np.full(len(position), OPACITY, np.float32)
    colour, slope = light[:, None, :] / np.float32(constants.SH_C0), np.zeros((len(position), 2), np.float32)
    relief = None if beside is None else np.zeros((len(position), *beside.relief.shape[1:]), np.float32)
    return Gaussians(position, rotation_to(normal), scale, opacity, colour, slope, relief)


def changed(
    state: SurfaceState,
    limit: int,
    optimiser: SurfaceOptimiser,
    surface: SurfaceSamples,
    rng: np.random.Generator,
    occlusion: Occlusion | None = None,
) -> SurfaceState:
    """Change the number of Gaussians to at most `limit`, and solve for the colours.

    Removes duplicates and Gaussians that hardly any sample sees, adds some where samples of the `surface` are badly
    fitted, and cuts those that reach across an occluder.
    """
    state = state.keep(
        ~(to_remove(optimiser.share(state.gaussians)) | to_merge(state.gaussians, optimiser.level_of(state.gaussians)))
    )
    state = state.joined(where_wrong(state.gaussians, limit - len(state), optimiser, surface, rng))
    if occlusion:
        return state.cut(*cut_where_better(state.gaussians, optimiser, occlusion))
    return replace(state, gaussians=optimiser.solve(state.gaussians))


def where_wrong(
    gaussians: Gaussians, room: int, optimiser: SurfaceOptimiser, surface: SurfaceSamples, rng: np.random.Generator
) -> Gaussians:
    """At most `room` new Gaussians on the `surface`, as dense as its samples times the error around them.

    They lie on the surfaces that are badly fitted. The halves of Gaussians that have much error would not: a Gaussian
    too large for the thing that it was to light has turned away from it, and its halves stay turned. The error is the
    noise-free one, averaged over blocks of neighbours on the same surface.
    """
    error = optimiser.error(gaussians)[: len(surface)]
    (around,) = surface.blocks.means(error)
    around = np.maximum(around, 0)[surface.blocks.number]
    count = max(min(room, np.count_nonzero(around) // BADLY_FITTED), 0)
    return start(surface[drawn(around, CANDIDATES * count, rng)], count, rng, gaussians)
