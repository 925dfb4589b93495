"""The tasks of a bake with `surface`: known light round by round, chunks of samples, both levels, light groups."""

from functools import partial

from gsgi.baker.bake import Baker
from gsgi.baker.plan import Plan
from gsgi.baker.progress import Progress
from gsgi.baker.surface.budget import PATHS_STEP
from gsgi.baker.surface.chunks import chunk_size, free_layers, surface_layers
from gsgi.baker.surface.fits import SurfaceFits
from gsgi.baker.surface.samples import Sampler

from .task import PLAN, Task, ignore, keys

FIT, COARSE = "fit", "coarse"


def surface_tasks(plan: Plan) -> list[Task]:
    """The tasks of a plan, without its references."""
    sampling = _Sampling(plan, plan.sampler)
    free, surface = sampling.chunks("free"), sampling.chunks("surface")
    coarse = Task(COARSE, "fit", keys(free), lambda progress: _fit_coarse(plan, progress))
    fit = Task(FIT, "fit", (*keys(surface), COARSE), lambda progress: _fitted(plan, progress))
    tasks = [*sampling.known, *free, coarse, *surface, fit]
    for number, name in enumerate(plan.groups, 1):
        tasks += _group_tasks(plan, name, f"group{number}")
    return tasks


def last_round(plan: Plan) -> str:
    """Key of the task that makes the light in which paths end; of the plan, if they are whole."""
    return _Sampling(plan, plan.sampler).ends_in


def _group_tasks(plan: Plan, name: str, key: str) -> list[Task]:
    sampling = _Sampling(plan, plan.group_sampler(name), key, f"light group {name}")
    chunks = [*sampling.chunks("free"), *sampling.chunks("surface")]
    solve = Task(key, sampling.stage, (*keys(chunks), FIT), lambda progress: _solve(plan, name, progress))
    return [*sampling.known, *chunks, solve]


class _Sampling:
    """The tasks of one sampler: of all light, or of a light group, whose `key` begins their keys."""

    def __init__(self, plan: Plan, sampler: Sampler, key: str = "", stage: str = ""):
        self._plan, self._sampler, self._key, self.stage = plan, sampler, key, stage

    @property
    def ends_in(self) -> str:
        """Key of the task that makes the light in which the samples' paths end."""
        rounds = len(self._sampler.rounds)
        return self._named(f"known{rounds}") if rounds else PLAN

    @property
    def known(self) -> list[Task]:
        """For each round of known light, its chunks and then the table of its light."""
        rounds, tasks, before = self._sampler.rounds, [], PLAN
        readers = [*(known.sampler for known in rounds[1:]), self._sampler]
        for number, (known, reader) in enumerate(zip(rounds, readers, strict=True), 1):
            stage, table = self.stage or "known light", f"known{number}"
            chunks = [
                self._chunk(f"{table}-{n}", stage, before, known.sampler, ("surface", n, layers), layers * PATHS_STEP)
                for n, layers in enumerate(known.layers)
            ]
            before = self._named(table)
            tasks += [*chunks, Task(before, stage, keys(chunks), partial(_make_table, reader, stage))]
        return tasks

    def chunks(self, stage: str) -> list[Task]:
        """The chunks of samples of a `stage`, "surface" or "free"."""
        plan, on_surfaces = self._plan, stage == "surface"
        layers = (surface_layers if on_surfaces else free_layers)(plan.settings.budget, plan.settings.samples)
        paths = plan.samples if on_surfaces else plan.free_samples
        shown = self.stage or "irradiance"
        return [
            self._chunk(f"{stage}-{n}", shown, self.ends_in, self._sampler, (stage, n, count), paths)
            for n, count in enumerate(layers)
        ]

    def _chunk(self, key: str, stage: str, before: str, sampler: Sampler, chunk: tuple, each: float) -> Task:
        """The task of a `chunk`, with `each` so many paths from a point."""
        paths = round(chunk_size(chunk[1]) * each)
        drawn = (key,) if self._key else ()  # a light group has the points that were drawn for all light
        whole = not sampler.rounds
        return Task(self._named(key), stage, (before, *drawn), partial(_trace, sampler, stage, chunk), paths, whole)

    def _named(self, key: str) -> str:
        return f"{self._key}-{key}" if self._key else key


def _trace(sampler: Sampler, stage: str, chunk: tuple[str, int, int], progress: Progress) -> None:
    kind, number, layers = chunk
    with progress.stage(stage, chunk_size(number) * layers * PATHS_STEP, "paths") as advance:
        sampler.prepare(ignore)
        sampler.chunk(kind, number, layers, advance)


def _make_table(reader: Sampler, stage: str, progress: Progress) -> None:
    with progress.stage(stage):
        reader.prepare(ignore)
        _ = reader.known_light


def _fit_coarse(plan: Plan, progress: Progress) -> None:
    with progress.stage("fit"):
        free = plan.sampler.free(free_layers(plan.settings.budget, plan.settings.samples), ignore)
        SurfaceFits(plan, progress).coarse(plan.settings.budget, free)


def _fitted(plan: Plan, progress: Progress) -> Baker:
    baker = Baker(plan, progress)
    baker.attempt(plan.settings.budget)
    return baker


def _solve(plan: Plan, name: str, progress: Progress) -> None:
    _fitted(plan, progress).light_group(name, plan.settings.budget)
