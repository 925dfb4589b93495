"""Manifests: what is written is read, and whatever lies is refused in one line."""

from contextlib import suppress
from pathlib import Path

import gsgi_files
import numpy as np
import pytest
import worlds

from gsgi.runtime.errors import FileError, FormatError
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.world.manifest import encode, read_manifest


@pytest.fixture
def path(tmp_path) -> Path:
    bakes = [gsgi_files.constant((n + 1.0,) * 3) for n in range(3)]
    return worlds.write(tmp_path, bakes, worlds.cells(3, 1, 1))


def test_a_manifest_is_read_as_it_was_written(path):
    manifest = read_manifest(path)
    assert (manifest.scene, manifest.effects, manifest.margin) == (7, Effects.EMISSIVE, worlds.MARGIN)
    assert [sector.neighbours for sector in manifest.sectors] == [(1,), (0, 2), (1,)]
    np.testing.assert_array_equal(manifest.boxes, worlds.cells(3, 1, 1))
    assert encode(manifest) == path.read_bytes()
    assert manifest.read(2).gaussians.sh[0, 0, 0] == pytest.approx(3 / 0.2821, rel=0.05)


@pytest.mark.parametrize(("change", "message"), worlds.LIES.values(), ids=worlds.LIES)
def test_a_manifest_that_lies_is_refused(path, change, message):
    with pytest.raises(FormatError) as caught:
        read_manifest(worlds.changed(path, change))
    text = str(caught.value)
    assert text.startswith(f"{path}: {message}"), text
    assert "\n" not in text
    assert len(text) < 300


def test_text_that_would_break_a_line_is_escaped(path):
    with pytest.raises(FormatError, match=r'sectors\[0\].file: expected a path inside its folder, got "\\ud800\\n"$'):
        read_manifest(worlds.changed(path, worlds.sector(0, file="\ud800\n")))


def test_no_damage_gives_another_error(path):
    """Of single bytes, and of values in place of others."""
    data, rng = path.read_bytes(), np.random.default_rng(5)
    for _ in range(400):
        damaged = bytearray(data)
        for at in rng.integers(len(data), size=rng.integers(1, 4)):
            damaged[at] = rng.choice(list(b'0x"[]{},:-.eE9\xff\n'))
        path.write_bytes(bytes(damaged))
        with suppress(FormatError, FileError):
            read_manifest(path)
    for name in ("format", "version", "scene", "effects", "margin", "sectors"):
        for value in (None, True, 1e400, 10**30, [], {}, [[]], [{}], "", [None]):
            path.write_bytes(data)
            with suppress(FormatError, FileError):
                read_manifest(worlds.changed(path, lambda v, name=name, value=value: v.update({name: value})))


def test_a_missing_file_is_told_at_once(path):
    gone = path.parent / read_manifest(path).sectors[1].file
    gone.unlink()
    with pytest.raises(FileError, match=r'sectors\[1\].file: "level.1-.*.gsgi" is missing$'):
        read_manifest(path)
    with pytest.raises(FileError, match="cannot read"):
        read_manifest(path.with_name("none.gsgi.json"))


def test_another_file_of_the_same_size_is_told_when_it_is_read(path):
    manifest = read_manifest(path)
    file = path.parent / manifest.sectors[0].file
    file.write_bytes(file.read_bytes()[:-1] + b"\0")
    with pytest.raises(FormatError, match=f"{file}: sha256: expected .*, as the manifest says, got"):
        read_manifest(path).read(0)


def test_memory_is_what_the_file_takes(path):
    with pytest.raises(FormatError, match="memory: expected 5, as the manifest says, got"):
        read_manifest(worlds.changed(path, worlds.sector(1, memory=5))).read(1)


def test_files_of_over_are_no_sectors(tmp_path):
    """They cannot be read at single points."""
    path = worlds.write(tmp_path, [gsgi_files.constant((1.0,) * 3)], worlds.cells(1, 1, 1))
    data = (gsgi_files.DATA / "v6_over.gsgi").read_bytes()
    name = read_manifest(path).sectors[0].file
    (tmp_path / name).write_bytes(data)
    digest = worlds.hashlib.sha256(data).hexdigest()
    with pytest.raises(FormatError, match="operator: expected surface, as all sectors of a world have, got over"):
        read_manifest(worlds.changed(path, worlds.sector(0, sha256=digest, bytes=len(data)))).read(0)
