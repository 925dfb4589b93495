"""Baking from Python: the same file as the command line's, a report, progress, and errors that say what is wrong."""

import json
import signal
from dataclasses import replace

import pytest
from command_flags import flags
from edits import edit, recoloured
from repository import SCENES
from small_tasks import place_quickly, sample_little

import gsgi
from gsgi.baker.cli.main import run
from gsgi.baker.evaluation import held_out
from gsgi.baker.trace import device

CORNELL = SCENES / "cornell.glb"
SMALL = gsgi.Settings(budget=64, views=2, size=24, samples=64, bounces=2, iterations=4)
FLAGS = flags(budget=64, views=2, view_size=24, samples=64, bounces=2, iterations=4)


@pytest.fixture(scope="module", autouse=True)
def quick():
    with pytest.MonkeyPatch.context() as patch:
        place_quickly(patch.setattr)
        sample_little(patch.setattr)
        patch.setattr(held_out, "SIZE", 64)
        patch.setattr(held_out, "SAMPLES", 256)
        yield


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def report(cache, tmp_path_factory):
    output = tmp_path_factory.mktemp("bake") / "room.gsgi"
    report = gsgi.bake(CORNELL, output, settings=SMALL, cache=cache)
    assert output.read_bytes() == report.data
    return report


def test_the_report_says_what_was_reached(report):
    bake = report.data
    assert 0 < report.gaussians <= 64
    assert len(bake) == report.as_dict()["bytes"]
    assert report.ssim == report.evaluation.mean.final.ssim > 0.5
    assert list(report.seconds) == [
        "scene", "views", "plan", "references", "known light", "irradiance", "fit", "encode", "evaluation",
    ]  # fmt: skip
    json.dumps(report.as_dict())  # plain numbers and strings
    assert report.warnings == ()
    assert report.missed is None


def test_the_command_line_makes_the_same_file(report, cache, tmp_path, capsys):
    output = tmp_path / "room.gsgi"
    assert run(["bake", str(CORNELL), "-o", str(output), *FLAGS, "--cache", str(cache), "-q", "--json"]) == 0
    assert output.read_bytes() == report.data
    printed = json.loads(capsys.readouterr().out)
    same = {"stages", "peak_memory", "attempts", "history"}  # seconds differ; what the cache held has no history
    assert {k: v for k, v in printed.items() if k not in same} == {
        k: v for k, v in report.as_dict().items() if k not in same
    }


def test_progress_is_told_stage_by_stage(cache, capsys):
    told = []
    gsgi.bake(CORNELL, settings=SMALL, cache=cache, evaluate=False, progress=lambda *step: told.append(step))
    stages = ["scene", "views", "plan", "known light", "irradiance", "fit", "encode"]
    assert list(dict.fromkeys(stage for stage, _ in told)) == stages
    for stage in {stage for stage, _ in told}:
        done = [share for name, share in told if name == stage]
        assert done[0] == 0.0
        assert done[-1] == 1.0
        assert done == sorted(done)
    assert capsys.readouterr() == ("", "")


def test_an_interrupted_bake_raises_and_the_same_call_goes_on(report, tmp_path):
    seen = []

    def interrupt(stage: str, share: float) -> None:
        seen.append(stage)
        if (stage, share) == ("fit", 0.0) and seen.count("fit") == 1:
            signal.raise_signal(signal.SIGINT)

    arguments = {"settings": SMALL, "cache": tmp_path / "cache", "evaluate": False, "progress": interrupt}
    with pytest.raises(KeyboardInterrupt):
        gsgi.bake(CORNELL, tmp_path / "x.gsgi", **arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
    assert gsgi.bake(CORNELL, tmp_path / "x.gsgi", **arguments).data == report.data
    assert (tmp_path / "x.gsgi").read_bytes() == report.data


@pytest.fixture
def before(report, tmp_path):
    """The file of the report, to be updated."""
    path = tmp_path / "before.gsgi"
    path.write_bytes(report.data)
    return path


def test_an_update_makes_the_file_of_the_command_line_and_counts_what_it_keeps(before, cache, tmp_path, capsys):
    scene = edit(CORNELL, tmp_path / "edited", recoloured(0, (0.6, 0.7, 0.5)))
    arguments = {"settings": SMALL, "cache": cache, "evaluate": False}
    report = gsgi.bake(scene, update=before, **arguments)
    assert report.warnings == ()
    kept = report.as_dict()["kept"]["samples"]
    assert kept["new"] == kept["gone"] == 0 < sum(kept.values())
    assert report.plan.kept.lines()
    output = tmp_path / "new.gsgi"
    where = ["-o", str(output), *FLAGS, "--cache", str(cache), "-q", "--json", "--no-evaluate"]
    assert run(["bake", str(scene), "--update", str(before), *where]) == 0
    assert output.read_bytes() == report.data
    assert json.loads(capsys.readouterr().out)["kept"]["samples"] == kept


def test_an_update_that_can_keep_nothing_warns_and_bakes(report, before, cache, tmp_path):
    again = gsgi.bake(CORNELL, settings=SMALL, cache=tmp_path / "empty", evaluate=False, update=before)
    assert again.data == report.data
    assert again.plan.kept is None
    assert "kept" not in again.as_dict()
    (line,) = again.warnings
    assert "knows nothing of its bake; baking all of it" in line
    with pytest.raises(gsgi.UsageError, match="update: cannot be had with seconds"):
        gsgi.bake(CORNELL, settings=gsgi.Settings(), cache=cache, update=before, seconds=10)
    with pytest.raises(gsgi.UsageError, match="update: cannot be had with a target loss"):
        gsgi.bake(CORNELL, settings=replace(SMALL, target_loss=0.1), cache=cache, update=before)
    with pytest.raises(gsgi.FileError, match=r"no\.gsgi"):
        gsgi.bake(CORNELL, settings=SMALL, cache=cache, update=tmp_path / "no.gsgi")


def test_the_device_is_the_one_that_is_asked_for(report, cache, tmp_path, monkeypatch):
    monkeypatch.setattr(device, "unavailable", lambda: "there is none")
    arguments = {"settings": SMALL, "cache": cache, "evaluate": False}
    assert gsgi.bake(CORNELL, device="auto", **arguments).data == report.data
    for call in (gsgi.bake, gsgi.bake_world):
        with pytest.raises(gsgi.UnsupportedError, match="no GPU can trace here: there is none"):
            call(CORNELL, tmp_path / "x.gsgi.json", device="cuda", **arguments)
    with pytest.raises(gsgi.UnsupportedError, match="there is none"):
        gsgi.plan(CORNELL, settings=SMALL, cache=cache, device="cuda")
    with pytest.raises(gsgi.UsageError, match="device: expected one of auto, cpu, cuda, got 'gpu'"):
        gsgi.bake(CORNELL, device="gpu", **arguments)
    assert not list(tmp_path.iterdir())


def test_without_an_evaluation_the_bytes_are_the_same(report, cache):
    other = gsgi.bake(gsgi.read_scene(CORNELL), settings=SMALL, cache=cache, evaluate=False)
    assert other.data == report.data
    assert other.evaluation is None
    assert other.ssim is None


def test_light_and_quality_are_arguments(cache):
    sky = gsgi.Lighting(env=(1.0, 1.0, 1.0))
    plan = gsgi.plan(CORNELL, quality="draft", settings=replace(SMALL, budget=None), lighting=sky, cache=cache)
    rows = {row.what: row.decision for row in plan.decisions}
    assert rows["environment"] == "one colour"
    assert plan.gaussians < gsgi.plan(CORNELL, settings=replace(SMALL, budget=None), cache=cache).gaussians
    assert set(plan.seconds) == {"known light", "irradiance", "fit", "references", "evaluation"}
    assert plan.memory > 1e8
    assert plan.file_bytes > 144


def test_a_target_that_is_missed_raises_and_writes_the_best_file(cache, tmp_path):
    output = tmp_path / "room.gsgi"
    with pytest.raises(gsgi.TargetError, match="above the target of 1e-09"):
        gsgi.bake(CORNELL, output, settings=replace(SMALL, target_loss=1e-9), cache=cache)
    assert len(gsgi.read_bake(output).gaussians) > 0


def test_errors_name_the_file(tmp_path, cache):
    with pytest.raises(gsgi.FileError, match=r"nothing\.glb: cannot read"):
        gsgi.bake(tmp_path / "nothing.glb", cache=cache)
    with pytest.raises(gsgi.FileError, match=r"no/room\.gsgi"):
        gsgi.bake(CORNELL, tmp_path / "no" / "room.gsgi", cache=cache)
    with pytest.raises(gsgi.UsageError, match="quality"):
        gsgi.bake(CORNELL, quality="best", cache=cache)
