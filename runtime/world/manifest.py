"""The manifest of a world, a JSON file that lists its sectors; docs/worlds.md describes it."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gsgi.runtime.errors import FileError, FormatError
from gsgi.runtime.file.reader import decoded
from gsgi.runtime.files import inside, read_file
from gsgi.runtime.gaussians import Bake, Effects

from .boxes import Box, neighbours, overlap

SUFFIX = ".json"
FORMAT, VERSION = "gsgi world", 1
SECTORS_MOST = 4096
BYTES_MOST = 1 << 24  # of a manifest: eight times as many as SECTORS_MOST sectors take
MEMORY_MOST = 1 << 40  # bytes

Number = int | float


@dataclass(frozen=True)
class Sector:
    """One sector: its `file` of so many `bytes`, their `sha256`, and the box that it lights.

    `file` is a path relative to the manifest's folder. `memory` (bytes) is what the Gaussians take once they are read.
    `low` and `high` are the corners of the box, world space, m, and `neighbours` the numbers of the sectors whose boxes
    share a part of a face with it, ascending.
    """

    file: str
    bytes: int
    sha256: str
    memory: int
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    neighbours: tuple[int, ...]

    @property
    def box(self) -> Box:
        """The corners of the box."""
        return np.array([self.low, self.high])


@dataclass(frozen=True)
class Manifest:
    """The `sectors` of a world whose manifest is the file `path`.

    `scene` is the fingerprint of the scene and `effects` those of its light. Files of sectors that an edit has not
    reached have those of the scene before. Where two boxes meet, the light of one sector turns into that of the other
    within `margin` (m) on both sides of the border.
    """

    path: Path
    scene: int
    effects: Effects
    margin: float
    sectors: tuple[Sector, ...]

    @property
    def boxes(self) -> np.ndarray:
        """The boxes of all sectors, (N, 2, 3) float64, m."""
        return np.array([sector.box for sector in self.sectors])

    def data(self, number: int) -> bytes:
        """The bytes of a sector's file. Raises FileError, or FormatError if they are not those of the manifest."""
        sector = self.sectors[number]
        path = self.path.parent / sector.file
        data = read_file(path, lambda size: _same(path, "bytes", sector.bytes, size))
        _same(path, "sha256", sector.sha256, hashlib.sha256(data).hexdigest())
        return data

    def read(self, number: int) -> Bake:
        """The light of one sector.

        Raises FileError or FormatError, which name the file, unless it is the one that the manifest describes.
        """
        data, sector = self.data(number), self.sectors[number]
        path = self.path.parent / sector.file
        bake = decoded(data, path)
        if bake.coarse is None:
            raise FormatError(f"{path}: operator: expected surface, as all sectors of a world have, got over")
        _same(path, "memory", sector.memory, memory(bake))
        return bake


def memory(bake: Bake) -> int:
    """Bytes of the arrays of a bake's Gaussians, of both levels."""
    return sum(array.nbytes for level in (bake.gaussians, bake.coarse) for array in vars(level).values())


def sectors_of(files: list[tuple[str, bytes, Bake]], boxes: np.ndarray) -> tuple[Sector, ...]:
    """The sectors with these files, their bytes and what these decode to, and boxes (N, 2, 3), m."""
    found = neighbours(boxes)
    return tuple(
        Sector(name, len(data), hashlib.sha256(data).hexdigest(), memory(bake), *map(tuple, box.tolist()), near)
        for (name, data, bake), box, near in zip(files, boxes, found, strict=True)
    )


def encode(manifest: Manifest) -> bytes:
    """The bytes of a manifest; the same manifest always gives the same bytes."""
    effects = [effect.name.lower() for effect in Effects if effect in manifest.effects]
    head = {"format": FORMAT, "version": VERSION, "scene": f"{manifest.scene:016x}", "effects": effects}
    lines = ",\n".join("    " + json.dumps(asdict(sector)) for sector in manifest.sectors)
    body = json.dumps(head | {"margin": manifest.margin}, indent=2)[:-2]
    return f'{body},\n  "sectors": [\n{lines}\n  ]\n}}\n'.encode()


def read_manifest(path: str | Path) -> Manifest:
    """Read a manifest, and make sure that its files are there and as long as it says.

    Raises FileError for files that cannot be read, FormatError for what no bake can have written; both name the file,
    and FormatError the field. The files' bytes are compared with their hashes when a sector is read.
    """
    path = Path(path)
    data = read_file(path, lambda size: _expect(path, size <= BYTES_MOST, "", f"at most {BYTES_MOST} bytes", size))
    try:
        value = json.loads(data, parse_constant=_not_json)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: expected JSON: {error}") from None
    manifest = _manifest(path, value)
    _check_boxes(manifest)
    for number, sector in enumerate(manifest.sectors):
        _check_file(manifest, number, sector)
    return manifest


def _manifest(path: Path, value) -> Manifest:
    read = _Reader(path)
    root = read.members(value, "", {"format", "version", "scene", "effects", "margin", "sectors"}, partly=True)
    read.expect(root.get("format") == FORMAT, "format", repr(FORMAT), root.get("format"))
    version = read.whole(root.get("version"), "version", 1 << 31)
    read.expect(version == VERSION, "version", f"{VERSION}", version)
    root = read.members(value, "", {"format", "version", "scene", "effects", "margin", "sectors"})
    scene, known = root["scene"], {effect.name.lower(): effect for effect in Effects}
    read.expect(_hexadecimal(scene, 16), "scene", "16 hexadecimal digits", scene)
    effects = Effects(0)
    for name in read.array(root["effects"], "effects", 0, len(known)):
        read.expect(isinstance(name, str) and name in known, "effects", f"names of {', '.join(known)}", name)
        effects |= known[name]
    margin = read.number(root["margin"], "margin")
    read.expect(margin > 0, "margin", "more than 0", margin)
    sectors = read.array(root["sectors"], "sectors", 1, SECTORS_MOST)
    count = len(sectors)
    found = (_sector(read, sector, f"sectors[{i}]", count) for i, sector in enumerate(sectors))
    return Manifest(path, int(scene, 16), effects, margin, tuple(found))


def _sector(read: "_Reader", value, at: str, count: int) -> Sector:
    members = read.members(value, at, set(Sector.__dataclass_fields__))
    file, digest = members["file"], members["sha256"]
    read.expect(isinstance(file, str) and 0 < len(file) < 256, f"{at}.file", "a name of 1 to 255 characters", file)
    read.expect(_hexadecimal(digest, 64), f"{at}.sha256", "64 hexadecimal digits", digest)
    sizes = (read.whole(members[name], f"{at}.{name}", MEMORY_MOST) for name in ("bytes", "memory"))
    low, high = (
        tuple(read.number(x, f"{at}.{name}") for x in read.array(members[name], f"{at}.{name}", 3, 3))
        for name in ("low", "high")
    )
    wide = all(a < b for a, b in zip(low, high, strict=True))
    read.expect(wide, f"{at}.high", f"more than low, {list(low)}", list(high))
    near = read.array(members["neighbours"], f"{at}.neighbours", 0, SECTORS_MOST)
    near = tuple(read.whole(number, f"{at}.neighbours", count - 1) for number in near)
    size, taken = sizes
    return Sector(file, size, digest, taken, low, high, near)


def _check_boxes(manifest: Manifest) -> None:
    """Refuse boxes that overlap, and neighbours that are not those of the boxes."""
    boxes = manifest.boxes
    if pair := overlap(boxes):
        a, b = (f"sectors[{number}]" for number in pair)
        raise FormatError(f"{manifest.path}: {b}: expected a box of its own, got one that overlaps {a}")
    for number, (sector, found) in enumerate(zip(manifest.sectors, neighbours(boxes), strict=True)):
        same = sector.neighbours == found
        _expect(manifest.path, same, f"sectors[{number}].neighbours", list(found), list(sector.neighbours))


def _check_file(manifest: Manifest, number: int, sector: Sector) -> None:
    at = f"sectors[{number}]"
    try:
        path = inside(manifest.path.parent.resolve(), sector.file)
    except (ValueError, OSError, RuntimeError):
        path = None
    _expect(manifest.path, path is not None, f"{at}.file", "a path inside its folder", sector.file)
    try:
        size = path.stat().st_size if path.is_file() else None
    except OSError:
        size = None
    if size is None:
        raise FileError(f"{manifest.path}: {at}.file: {json.dumps(sector.file)} is missing")
    _expect(manifest.path, size == sector.bytes, f"{at}.bytes", f"{size}, the size of {sector.file}", sector.bytes)


class _Reader:
    """Checks values of the manifest at `path`; errors name the field."""

    def __init__(self, path: Path):
        self._path = path

    def expect(self, condition: bool, field: str, expected: str, got) -> None:
        _expect(self._path, condition, field, expected, got)

    def members(self, value, field: str, names: set[str], partly: bool = False) -> dict:
        self.expect(isinstance(value, dict), field, "an object", value)
        if not partly:
            for name in sorted(names ^ value.keys()):
                known = name in names
                expected = "a value" if known else "no such member"
                self.expect(False, f"{field}.{name}" if field else name, expected, value.get(name, "none"))
        return value

    def array(self, value, field: str, least: int, most: int) -> list:
        here = isinstance(value, list) and least <= len(value) <= most
        self.expect(here, field, f"an array of {least} to {most} values", value)
        return value

    def number(self, value, field: str) -> float:
        finite = isinstance(value, Number) and not isinstance(value, bool) and abs(value) <= 1e12
        self.expect(finite, field, "a finite number, at most 1e12", value)
        return float(value)

    def whole(self, value, field: str, most: int) -> int:
        here = isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most
        self.expect(here, field, f"a whole number from 0 to {most}", value)
        return value


def _hexadecimal(value, digits: int) -> bool:
    return isinstance(value, str) and len(value) == digits and set(value) <= set("0123456789abcdef")


def _not_json(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _same(path: Path, field: str, expected, got) -> None:
    _expect(path, expected == got, field, f"{expected}, as the manifest says", got)


def _expect(path: Path, condition: bool, field: str, expected, got) -> None:
    if not condition:
        shown = json.dumps(got, default=str)  # escapes whatever is no plain text
        shown = shown if len(shown) <= 80 else f"{shown[:77]}..."
        raise FormatError(f"{path}: {field + ': ' if field else ''}expected {expected}, got {shown}")
