"""A world as tasks, one for each sector, that several processes and machines can share."""

from functools import partial

from gsgi.baker import estimate
from gsgi.baker.cache.digest import digest
from gsgi.baker.cache.store import Cache
from gsgi.baker.progress import Progress
from gsgi.baker.tasks.request import Request
from gsgi.baker.tasks.task import PLAN, Task, ignore

from .world_baker import WorldBaker, check


class WorldWork:
    """The bake of a world in sectors of at most `size` m; None: as wide as the scene calls for.

    `baker` is there once `tasks` has made it; it is not sent to other processes. A sector is one task: it needs nothing
    of others, and a world has more of them than a cluster has nodes.
    """

    def __init__(self, request: Request, size: float | None):
        check(request)
        self.request, self.size, self.baker = request, size, None
        self.digest = digest({"request": request.digest, "sectors": size})

    def __reduce__(self):
        return WorldWork, (self.request, self.size)

    def tasks(self, progress: Progress, cache: Cache) -> list[Task]:
        """As in `Work`."""
        self.baker = WorldBaker(self.request, self.size, progress, cache)
        sectors = range(len(self.baker.division.boxes))
        plan = Task(PLAN, "sectors", (), ignore)
        return [plan, *(Task(f"sector-{n}", "sector", (PLAN,), partial(self.baker.sector, n)) for n in sectors)]

    def seconds(self, progress: Progress) -> dict[str, float]:
        """As in `Work`: all sectors are expected to take as long as the one with the most surface."""
        before = sum(progress.seconds.get(stage, 0.0) for stage in ("views", "plan"))
        largest = self.baker.plan(self.baker.division.largest, progress)
        planned = progress.seconds["views"] + progress.seconds["plan"] - before
        with progress.stage("estimate"):
            each = planned + sum(estimate.estimate(largest).values())
        sectors = range(len(self.baker.division.boxes))
        return {PLAN: progress.seconds["sectors"]} | {f"sector-{n}": each for n in sectors}
