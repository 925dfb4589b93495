"""The report of a bake in sectors, as a record and as JSON."""

from dataclasses import dataclass

from gsgi.runtime.world.manifest import Manifest


@dataclass(frozen=True)
class WorldReport:
    """The `manifest` that was written, and the report of each sector's own bake, as `BakeReport.as_dict` gives it.

    `seconds` are by stage, of all sectors that were baked now, and `found` is the number of those that the cache held.
    `kept` is the number of those whose files are those from before an edit; None without an update.
    `peak_memory` (bytes) is that of the process; None if the system does not report it. `warnings` are one line each.
    """

    manifest: Manifest
    sectors: tuple[dict, ...]
    found: int
    kept: int | None
    seconds: dict[str, float]
    peak_memory: int | None
    warnings: tuple[str, ...]

    @property
    def gaussians(self) -> int:
        """Gaussians of all sectors."""
        return sum(sector["gaussians"] for sector in self.sectors)

    @property
    def bytes(self) -> int:
        """Bytes of all .gsgi files."""
        return sum(sector.bytes for sector in self.manifest.sectors)

    @property
    def worst(self) -> tuple[int, dict] | None:
        """The number of the sector whose worst held-out view is the worst of all, and that view; None if unknown."""
        views = [(n, s["held_out"]["worst"]) for n, s in enumerate(self.sectors) if s["held_out"]]
        views = [(number, view) for number, view in views if view]
        return min(views, key=lambda each: each[1]["final"]["ssim"], default=None)

    def as_dict(self) -> dict:
        """The report as numbers, strings, lists and dictionaries, for JSON."""
        places = zip(self.manifest.sectors, self.sectors, strict=True)
        return {
            "gaussians": self.gaussians,
            "bytes": self.bytes,
            "margin": self.manifest.margin,
            "sectors": [{"file": s.file, "low": s.low, "high": s.high} | made for s, made in places],
            "from_cache": self.found,
            **({} if self.kept is None else {"kept": self.kept}),
            "peak_memory": self.peak_memory,
            "stages": [{"stage": name, "seconds": round(value, 3)} for name, value in self.seconds.items()],
        }
