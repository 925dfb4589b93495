"""The light in which paths end, from samples of it, with the lit and bright places and the guide of these paths."""

from dataclasses import replace

import numpy as np

from .bright_places import BrightPlaces
from .guide import Guide
from .irradiance_cache import IrradianceCache, KnownLight
from .lit_places import LitPlaces
from .local_light import Blocks
from .tracer import Sampling, Tracer

# Connections pay if they divide the variance of a path by at least PAYS, for they take half as long as the rest of it,
# and in some scenes four fifths. That is tried at so many points with so many paths in each half, by the geometric mean
# over them of noise relative to the light around, of which less than NOISE_LEAST does no harm.
PAYS = 1.8
TRIED, TRIED_PATHS, NOISE_LEAST = 4096, 32, 0.02


def known_light(
    tracer: Tracer,
    position: np.ndarray,
    normal: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    bounces: int,
    before: KnownLight | None = None,
) -> KnownLight:
    """Known light from both halves `a` and `b` (S, 3) of B at samples, position (S, 3) m and normal (S, 3) unit.

    Paths of at most so many `bounces` will end in it. They are guided, and connected to lit and to bright places if
    that pays. `before` is what the paths of the samples ended in: its places stay, and by its guide the next is
    learned.
    """
    from .gathered import gather
    from .learned_guide import learn as learn_guide

    light = cached(tracer, position, normal, a, b)
    if not before:
        return learned(tracer, light, position, normal, a, b, bounces)
    light = _shining(tracer, _with(light, before.a.lit, before.b.lit), before.a.bright, bounces)
    # What a half knows does not bias the other, whose paths it only guides.
    guided = replace(light.a, guide=before.a.guide)
    return _guided(light, learn_guide(gather(tracer, position, normal, guided, bounces)))


def learned(
    tracer: Tracer, light: KnownLight, position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray,
    bounces: int, alike: bool = False,
) -> KnownLight:  # fmt: skip
    """The `light` with its places and its guide, which are learned at samples, as `known_light` has them.

    `alike`: the lit places of both halves are the same, which are found in half the time, but noise in them is not seen
    any more.
    """
    from .gathered import gather
    from .learned_bright import chosen_by
    from .learned_bright import learn as learn_bright
    from .learned_guide import learn as learn_guide

    if tracer.lights.count:
        from .learned_places import learn

        places = [learn(tracer, position, normal, seed) for seed in range(1 if alike else 2)]
        other = _with(light, places[0], places[-1])
        if other.connected and _pays(tracer, position, normal, bounces, light, other):
            light = other
    paths = gather(tracer, position, normal, light.a, bounces)
    guided = _guided(light, learn_guide(paths))
    parts = learn_bright(tracer, paths, a[paths.of], b[paths.of])
    if not len(parts.of):
        return guided
    shining = _shining(tracer, light, parts, bounces)
    choice = chosen_by(tracer, shining.a.bright, position, normal)
    both = (replace(half, bright=replace(choice, place=half.bright.place)) for half in (shining.a, shining.b))
    shining = KnownLight(*both)
    shining = _guided(shining, learn_guide(gather(tracer, position, normal, shining.a, bounces)))
    return shining if _pays(tracer, position, normal, bounces, guided, shining) else guided


def _pays(tracer: Tracer, position, normal, bounces: int, plain: KnownLight, connected: KnownLight) -> bool:
    """Whether connections take enough of the variance of paths away that end in known light."""
    some = np.random.default_rng(0).permutation(len(position))[:TRIED]
    points, sampling = (position[some], normal[some], normal[some]), Sampling(TRIED_PATHS, bounces)
    sides = plain, connected
    tried = [[half.mean for half in tracer.halves(*points, sampling, seed, known=k)] for seed, k in enumerate(sides)]
    mean_before, mean_after = ((a + b) / 2 for a, b in tried)
    # The difference of the means has the variance of both, and shows what plain paths hardly ever find.
    blocks = Blocks.of(*points[:2])
    both = blocks.light(mean_before, mean_after)
    either = np.square(2 * both.noise / both.level) + NOISE_LEAST**2
    after = np.square(blocks.light(*tried[1]).noise / both.level) + NOISE_LEAST**2
    return np.log(either / after).mean() > np.log(1 + PAYS)


def known_light_again(
    tracer: Tracer, position: np.ndarray, normal: np.ndarray, a: np.ndarray, b: np.ndarray, bounces: int,
    edited: KnownLight,
) -> KnownLight:  # fmt: skip
    """The same after an edit of a scene whose known light was `edited`: in its cells, and by its directions of lights.

    They are guided as before. So paths that meet nothing changed bring the same bits.
    """
    light = cached(tracer, position, normal, a, b, edited.a)
    lit = edited.a.lit, edited.b.lit
    if edited.connected:
        from .learned_places import lit_again

        lit = [lit_again(tracer, half) for half in lit]
    parts = found_again(tracer, edited).a.bright
    return _guided(_shining(tracer, _with(light, *lit), parts, bounces), edited.a.guide)


def found_again(tracer: Tracer, edited: KnownLight) -> KnownLight:
    """The same known light after an edit that has not changed it: its bright places are on triangles of other rows."""
    if not len(edited.a.bright):
        return edited
    from .learned_bright import rows_again

    row = rows_again(tracer, edited.a.bright)
    return KnownLight(*(replace(half, bright=half.bright.in_rows(row)) for half in (edited.a, edited.b)))


def cached(tracer: Tracer, position, normal, a, b, like: IrradianceCache | None = None) -> KnownLight:
    """The caches of both halves of B, but for what paths ask for where they end."""
    asked = tracer.asked_through_filters(position, normal)
    return IrradianceCache.halves(position, normal, a - asked, b - asked, tracer.blocked, like)


def _with(light: KnownLight, a: LitPlaces, b: LitPlaces) -> KnownLight:
    """The light with the lit places of both halves."""
    return KnownLight(replace(light.a, lit=a), replace(light.b, lit=b))


def _guided(light: KnownLight, guide: Guide) -> KnownLight:
    """The light with a guide for both halves."""
    return KnownLight(*(replace(half, guide=guide) for half in (light.a, light.b)))


def _shining(tracer: Tracer, light: KnownLight, parts: BrightPlaces, bounces: int) -> KnownLight:
    """The light with bright places in `parts`, if there are any, each half with its own and by its own light."""
    if not len(parts.of):
        return light
    from .learned_bright import lit

    halves = enumerate((light.a, light.b))
    return KnownLight(*(replace(half, bright=lit(tracer, parts, half, bounces, seed)) for seed, half in halves))
