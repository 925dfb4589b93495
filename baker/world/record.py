"""What a bake of a world leaves in the cache about itself, for one of the same world after an edit."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gsgi.baker.cache.store import Cache, task_key
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.update.parts import Part
from gsgi.baker.update.plan import NothingToKeepError, check_same, check_scene, say_changes
from gsgi.baker.update.record import find_parts, keep_parts, settings_of
from gsgi.runtime.errors import UsageError
from gsgi.runtime.world.manifest import SUFFIX, Manifest, encode, read_manifest


@dataclass(frozen=True)
class WorldRecord:
    """How the world of a `manifest` was baked.

    `code` is the version of the code that baked it; `asked` are the settings that were asked for, and `size` that of
    the sectors (m), None where the scene decided it. `parts` are those of the scene. `sectors` has the key of what the
    cache has of each sector, its file and its report.
    """

    manifest: Manifest
    code: str
    asked: Settings
    size: float | None
    parts: list[Part]
    sectors: tuple[str, ...]

    def keep(self, cache: Cache) -> None:
        """Keep the record in a cache."""
        rest = {
            "code": self.code,
            "asked": asdict(self.asked),
            "size": self.size,
            "parts": keep_parts(cache, self.parts),
            "sectors": self.sectors,
        }
        cache.put(_key(self.manifest), {"record": np.frombuffer(json.dumps(rest).encode(), np.uint8)})

    @staticmethod
    def find(cache: Cache, manifest: Manifest) -> "WorldRecord | None":
        """The record that a cache has of the world of a manifest; None if it has none."""
        arrays = cache.get(_key(manifest))
        rest = arrays and json.loads(arrays["record"].tobytes())
        parts = rest and find_parts(cache, rest["parts"])
        if parts is None:
            return None
        made = rest["code"], settings_of(rest["asked"]), rest["size"]
        return WorldRecord(manifest, *made, parts, tuple(rest["sectors"]))

    def file(self, cache: Cache, number: int) -> tuple[bytes, dict]:
        """The file of a sector and the report of its bake.

        Raises FileError or FormatError for a file that is not the manifest's, NothingToKeepError without a report.
        """
        data = self.manifest.data(number)
        found = cache.get(self.sectors[number])
        if found is None:
            raise NothingToKeepError(f"the cache {cache.folder} no longer holds its samples")
        return data, json.loads(found["report"].tobytes())


def earlier_world(
    path: Path, size: float | None, settings: Settings, now: Sequence[Part], progress: Progress, cache: Cache
) -> WorldRecord | None:
    """The record of the bake that wrote a manifest, for one with this size of sectors and these settings.

    `now` are the parts of the scene after the edit. None, with a warning, if nothing can be kept. Raises FileError or
    FormatError for the manifest, and UsageError for a file with another name.
    """
    if path.suffix != SUFFIX:
        raise UsageError(f"--update {path}: expected the manifest of a world, a {SUFFIX} file, with --sectors")
    manifest = read_manifest(path)
    record = WorldRecord.find(cache, manifest)
    try:
        if record is None:
            raise NothingToKeepError(f"the cache {cache.folder} knows nothing of its bake")
        check_same(record.code, record.asked, settings)
        if record.size != size:
            before, after = ("auto" if each is None else f"{each:g}" for each in (record.size, size))
            raise NothingToKeepError(f"it was baked with --sectors {before}, now {after}")
        check_scene(record.parts, now)
        for number in range(len(manifest.sectors)):
            manifest.data(number)  # a file that is not the manifest's is said before any work
    except NothingToKeepError as reason:
        progress.warn(f"{path}: {reason}; baking all of it")
        return None
    say_changes(record.parts, now, progress)
    return record


def _key(manifest: Manifest) -> str:
    return task_key("world", manifest=np.frombuffer(encode(manifest), np.uint8))
