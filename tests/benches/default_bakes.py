"""Default bakes, each with its report, of the scenes that benchmarks draw; their light is cached in build/bench."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from repository import ROOT, SCENES, SHARED

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake

from .scenes import bake

FILES = (
    SCENES / "cornell.glb",
    SHARED / "sponza_crytek/sponza_sun.gltf",
    SHARED / "breakfast_room/breakfast_room_sun.gltf",
    SHARED / "modern_hall/modern_hall.gltf",
)
FOLDER = ROOT / "build" / "bench"


@dataclass(frozen=True, eq=False)
class DefaultBake:
    """A bake of the scene in file `scene`: the `report` of `gsgi bake --json`, and the .gsgi `file`."""

    scene: Path
    operator: str
    report: dict
    file: Path

    @property
    def gaussians(self) -> int:
        """Gaussians of both levels."""
        return self.report["gaussians"]

    def read(self) -> Bake:
        """Decode the file, as a reader does."""
        return codec.decode(self.file.read_bytes())


def scene_files() -> list[Path]:
    """Those of FILES that exist."""
    return [path for path in FILES if path.exists()]


@cache
def default_bake(path: Path, operator: str) -> DefaultBake:
    """Bake a scene with default settings; what an earlier run has traced and fitted is not repeated."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{path.stem}-{operator}.gsgi"
    report = bake(path, FOLDER / "cache", "--operator", operator, "-o", str(file))
    return DefaultBake(path, operator, report, file)
