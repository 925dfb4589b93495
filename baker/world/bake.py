"""Bake a scene in sectors, one after another, into files and a manifest of them."""

import hashlib
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from gsgi.baker.effects import effects
from gsgi.baker.report import peak_memory
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.world.manifest import SUFFIX, Manifest, encode, sectors_of

from .division import Division
from .report import WorldReport
from .world_baker import BakedSector, WorldBaker

HASH_DIGITS = 12  # of a file's hash that its name has


def bake_world(baker: WorldBaker, output: Path, write: Callable[[bytes], None]) -> WorldReport:
    """Bake a scene in sectors, and write their files; `write(data)` then writes the manifest `output`.

    An interrupted bake leaves an older manifest and its files as they were. Files of older bakes that the new manifest
    does not name are removed. The same request gives the same bytes. Raises what baking raises.
    """
    progress = baker.progress
    progress.say(told(baker.division))
    manifest, sectors = _baked(baker, output)
    baker.keep(manifest, sectors)
    write(encode(manifest))
    _remove_older(output, {sector.file for sector in manifest.sectors})
    reports, found = tuple(sector.report for sector in sectors), sum(sector.found for sector in sectors)
    kept = sum(sector.kept for sector in sectors) if baker.updates else None
    return WorldReport(manifest, reports, found, kept, dict(progress.seconds), peak_memory(), tuple(progress.warnings))


def _baked(baker: WorldBaker, output: Path) -> tuple[Manifest, list[BakedSector]]:
    """Bake all sectors, each into a file beside `output`. The manifest, which is not written, names them."""
    files, sectors = [], []
    for number in range(len(baker.division.boxes)):
        sector = baker.sector(number, baker.progress)
        name = f"{stem(output)}.{number}-{hashlib.sha256(sector.data).hexdigest()[:HASH_DIGITS]}.gsgi"
        write_atomic(output.parent / name, sector.data)
        files.append((name, sector.data, codec.decode(sector.data)))
        sectors.append(sector)
    made = baker.tracer.fingerprint, effects(baker.tracer.scene), baker.division.margin
    return Manifest(output, *made, sectors_of(files, baker.division.boxes)), sectors


def told(division: Division) -> str:
    """The division as one line for the log."""
    edges = division.boxes[0, 1] - division.boxes[0, 0]
    size = " x ".join(f"{edge:.3g}" for edge in edges)
    return f"{len(division.boxes)} sectors of {size} m, which meet in borders of {2 * division.margin:.2g} m"


def stem(output: Path) -> str:
    """What the names of a manifest's files begin with: `level` of level.gsgi.json. Raises UsageError."""
    name = output.name.removesuffix(SUFFIX)
    if name == output.name or not name.removesuffix(".gsgi"):
        raise UsageError(f"{output}: expected a name that ends in {SUFFIX} for the manifest of sectors")
    return name.removesuffix(".gsgi")


def _remove_older(output: Path, kept: Iterable[str]) -> None:
    """Remove the files of sectors beside `output` that an older manifest of this name has named."""
    ours = re.compile(rf"{re.escape(stem(output))}\.\d+-[0-9a-f]{{{HASH_DIGITS}}}\.gsgi")
    for path in output.parent.iterdir():
        if ours.fullmatch(path.name) and path.name not in kept:
            with suppress(OSError):
                path.unlink()
