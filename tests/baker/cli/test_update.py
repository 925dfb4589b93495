"""`gsgi bake --update`: a bake after an edit, what it says, and why there may be nothing to keep."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from edits import edit, moved, recoloured
from repository import SCENES
from small_tasks import SURFACE, make_small
from traced_paths import counted

import gsgi
from gsgi.baker.cli import main
from gsgi.baker.surface import chunks
from gsgi.baker.update import record
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake

FURNACE = SCENES / "furnace.glb"
FLAGS = SURFACE[1:]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with a bake, its cache, and a scene whose walls have another colour."""
    folder = tmp_path_factory.mktemp("update")
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch.setattr)
        assert main.run(["bake", *SURFACE, "-o", str(folder / "old.gsgi"), "--cache", str(folder / "cache"), "-q"]) == 0
        edit(FURNACE, folder / "edited", recoloured(0, (0.4, 0.5, 0.6)))
        yield folder


def updated(folder: Path, scene: Path, output: str, *more: str, code: int = 0, old: str = "old.gsgi") -> Path:
    """The file of an update."""
    where = ["--update", str(folder / old), "-o", str(folder / output), "--cache", str(folder / "cache")]
    assert main.run(["bake", str(scene), *FLAGS, *where, *more]) == code
    return folder / output


def told(capsys) -> str:
    return capsys.readouterr().err


def test_an_update_says_what_has_changed_and_what_it_kept(folder, capsys):
    scene = folder / "edited" / FURNACE.name
    first = updated(folder, scene, "new.gsgi", "--json")
    out, err = capsys.readouterr()
    assert "changed: material" in err
    assert ", 1 fit steps" in err  # a twentieth
    for kind in ("known light", "samples", "references"):
        assert f"{kind}, " in err
    kept = json.loads(out)["kept"]
    assert kept["samples"]["again"] > 0
    assert kept["samples"]["new"] == 0
    again = updated(folder, scene, "again.gsgi")
    assert again.read_bytes() == first.read_bytes()
    light = codec.decode(first.read_bytes()).coarse.sh[:, 0].mean(axis=0)
    assert light[0] < light[1] < light[2]
    capsys.readouterr()
    updated(folder, FURNACE, "back.gsgi", old="new.gsgi")
    assert "baking all" not in told(capsys)


def test_where_nothing_can_be_kept_one_line_says_why(folder, capsys, monkeypatch):
    def why(*more: str, scene: Path = FURNACE) -> str:
        # A bake that begins stops at once; the reason is given before.
        monkeypatch.setattr("gsgi.baker.tasks.request.make_plan", stop)
        updated(folder, scene, "never.gsgi", *more, code=130)
        (line,) = [line for line in told(capsys).splitlines() if "baking all of it" in line]
        return line

    def stop(*_):
        raise KeyboardInterrupt

    assert "with other settings: budget 8, now 9" in why("--budget", "9")
    assert "with other light groups: none, now base, sky" in why("--group", "sky=environment")
    elsewhere = edit(FURNACE, folder / "elsewhere", moved({"furnace", "box", "room", "walls"}, (9.0, 0.0, 0.0)))
    assert "of another scene" in why(scene=elsewhere)
    monkeypatch.setattr(record, "code", lambda: "another")
    monkeypatch.setattr("gsgi.baker.update.plan.code", lambda: "another")
    assert "another version of gsgi" in why()
    monkeypatch.undo()
    assert "knows nothing of its bake" in why("--cache", str(folder / "empty"))


def test_light_groups_are_kept_and_follow_an_edit(tmp_path, monkeypatch):
    make_small(monkeypatch.setattr)
    monkeypatch.setattr(chunks, "CHUNK", 1 << 12)
    scene = edit(SCENES / "cornell.glb", tmp_path / "edited", recoloured(0, (0.2, 0.5, 0.9)))
    light = ["--group", "lamp=ceiling*", "--no-evaluate", "--quiet", "--budget", "256"]
    paths = counted(monkeypatch)

    def bake(scene: Path, name: str, cache: str, *more: str) -> tuple[Bake, int]:
        """The bake, and how many paths it has traced."""
        paths.clear()
        file = tmp_path / f"{name}.gsgi"
        where = ["-o", str(file), "--cache", str(tmp_path / cache)]
        assert main.run(["bake", str(scene), *FLAGS, *light, *where, *more]) == 0
        return codec.decode(file.read_bytes()), sum(paths)

    old, whole = bake(SCENES / "cornell.glb", "old", "cache")
    update = "--update", str(tmp_path / "old.gsgi")
    _, thin = bake(SCENES / "cornell.glb", "same", "cache", *update)
    assert 0 < thin < whole / 8
    new, _ = bake(scene, "new", "cache", *update)
    # A whole bake is guided by its own light, along other paths: of so few, the light of two seeds differs by a tenth.
    whole_bakes = [bake(scene, f"full {seed}", "other", "--seed", str(seed))[0] for seed in range(3)]
    rng = np.random.default_rng(0)
    place, way = rng.uniform((-0.2, 0.1, -0.5), (0.2, 0.5, -0.1), (256, 3)), rng.normal(size=(256, 3))
    for name in ("base", "lamp"):
        alone = {other: float(other == name) for other in ("base", "lamp")}
        a, b, *c = (gsgi.sample(one, place, way, alone).mean(axis=0) for one in (old, new, *whole_bakes))
        kept, found = (np.linalg.norm(light / np.mean(c, axis=0) - 1) for light in (a, b))
        assert found < kept / 8
    again, few = bake(scene, "again", "cache", "--update", str(tmp_path / "new.gsgi"))  # an update of an update
    assert 0 < few < whole / 8
    assert [group.name for group in again.groups] == ["base", "lamp"]


def test_what_decides_anew_what_to_trace_is_refused(folder, capsys):
    for flags in (["--target-loss", "0.1"], ["--ray", "auto"]):
        updated(folder, FURNACE, "never.gsgi", *flags, code=1)
        assert f"--update: cannot be given with {flags[0]}" in told(capsys)
    updated(folder, FURNACE, "never.gsgi", code=2, old="absent.gsgi")
    (folder / "broken.gsgi").write_bytes(b"no light")
    updated(folder, FURNACE, "never.gsgi", code=3, old="broken.gsgi")


def test_a_record_is_found_as_it_was_kept(folder):
    from gsgi.baker.cache.store import Cache

    cache = Cache(folder / "cache")
    data = (folder / "old.gsgi").read_bytes()
    found = record.BakeRecord.find(cache, data)
    found.keep(cache, b"another file")
    again = record.BakeRecord.find(cache, b"another file")
    assert replace(again, placement=None, pilot=None) == replace(found, placement=None, pilot=None)
    assert again.pilot.lost == found.pilot.lost
    assert list(again.placement.fitted) == list(found.placement.fitted)
    assert again.entries
    assert all(map(cache.holds, again.entries))
    assert record.BakeRecord.find(cache, b"no file") is None
    assert found.references
    replace(found, references={}).keep(cache, b"another file")  # a bake without evaluation
    assert record.BakeRecord.find(cache, b"another file").references == found.references
