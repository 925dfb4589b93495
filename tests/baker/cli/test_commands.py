"""The command line on real files: the whole path, bad input, exit codes, and that nothing is left half-written."""

import base64
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from gltf_files import quad_scene, write
from repository import DATA, SCENES

from gsgi.baker import plan
from gsgi.baker.budget_search import FEWEST
from gsgi.baker.cache.store import entries
from gsgi.baker.cli import main
from gsgi.baker.cli.commands import COMMANDS
from gsgi.baker.evaluation import held_out
from gsgi.baker.plan import file_bytes
from gsgi.baker.settings import OPERATORS
from gsgi.baker.surface import budget, chunks
from gsgi.baker.trace.tracer import Tracer
from gsgi.baker.views import placement
from gsgi.runtime.file import codec
from gsgi.runtime.image import read_image, write_image
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.scene import Scene

CORNELL = str(SCENES / "cornell.glb")
SMALL = ["--views", "2", "--view-size", "24", "--samples", "64", "--iterations", "4"]
FAST = ["--budget", "64", *SMALL]
OVER = ["--operator", "over"]
HELD_OUT = 2  # views, as in QUICK


# The command line with fewer samples, in two chunks as by default, and an evaluation that takes seconds.
QUICK = """
from gsgi.baker.cli import main
from gsgi.baker.evaluation import held_out
from gsgi.baker.surface import budget, chunks
from gsgi.baker.views import placement
budget.SAMPLES_FEWEST, budget.KNOWN_MOST, chunks.CHUNK = 1 << 14, 1 << 14, 1 << 13
placement.HELD_OUT, held_out.SIZE, held_out.SAMPLES, held_out.GATHERED = 2, 64, 256, 128
main.main()
"""


def run(*command: str, **options) -> subprocess.CompletedProcess:
    command = list(map(str, (sys.executable, *command)))
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, **options)


def gsgi(*arguments: str, **options) -> subprocess.CompletedProcess:
    return run("-m", "gsgi.baker", *arguments, **options)


def write_floor(path: Path) -> Path:
    """A scene without light: a floor of albedo 0.5, 4 m across, and the camera "above" that sees nothing else."""
    position = np.array([[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]], "<f4")
    data = position.tobytes() + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    views = [{"buffer": 0, "byteOffset": a, "byteLength": n} for a, n in ((0, 48), (48, 12))]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-2, 0, -2], "max": [2, 0, 2]},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
    ]
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    matter = {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0}
    pose = {"translation": [0, 1.5, 0], "rotation": [-(0.5**0.5), 0, 0, 0.5**0.5]}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"name": "above", "camera": 0, **pose}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": matter}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": uri}],
    }
    path.write_text(json.dumps(document))
    return path


def refused(capsys, code: int, *arguments: str) -> str:
    """Run in this process; check the exit code and that stderr is one line; return that line."""
    assert main.run(list(map(str, arguments))) == code
    captured = capsys.readouterr()
    line = captured.err
    assert line.count("\n") == 1, line
    assert line.startswith("gsgi: ")
    assert not captured.out
    return line


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch) -> None:
    """A cache of its own for each test, outside its folder."""
    monkeypatch.setenv("GSGI_CACHE", str(tmp_path_factory.mktemp("cache")))


def bake_into(folder: Path, operator: str) -> Path:
    options = [*FAST, "--operator", operator, "--json", "--cache", folder / "cache"]
    options += ["--depfile", folder / "c.gsgi.d"]
    done = run("-c", QUICK, "bake", CORNELL, "-o", folder / "c.gsgi", *options)
    assert done.returncode == 0, done.stderr
    (folder / "bake.json").write_text(done.stdout)
    (folder / "bake.log").write_text(done.stderr)
    return folder


@pytest.fixture(scope="module")
def baked(tmp_path_factory) -> Path:
    """With the `over` operator, whose stages are more."""
    return bake_into(tmp_path_factory.mktemp("over"), "over")


@pytest.fixture(scope="module")
def bakes(baked, tmp_path_factory) -> dict[str, Path]:
    """One with each operator, of the same views."""
    return {"over": baked, "surface": bake_into(tmp_path_factory.mktemp("surface"), "surface")}


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_bake_reports_what_it_reached(bakes, operator, gl):
    baked = bakes[operator]
    report = json.loads((baked / "bake.json").read_text())
    assert report["operator"] == operator
    assert report["bytes"] == (baked / "c.gsgi").stat().st_size
    read = codec.decode((baked / "c.gsgi").read_bytes())
    assert report["gaussians"] == len(read.gaussians) + len(read.coarse or ())
    known = ["known light"] if operator == "surface" else []
    assert [row["stage"] for row in report["stages"]] == [
        "scene", "views", "plan", *known, "references", "irradiance", "fit", "encode", "evaluation",
    ]  # fmt: skip
    assert report["views"] == 2  # the scene's own cameras
    views, mean = report["held_out"]["views"], report["held_out"]["mean"]
    assert len(views) == HELD_OUT
    assert not {view["name"] for view in views} & {"front", "corner"}
    assert mean["name"] == f"mean of {HELD_OUT} views"
    assert report["bounces"] >= 4
    assert 0 <= report["coverage"][2] <= report["coverage"][0] <= 1
    for view in (*views, mean):
        assert 0 < view["loss"] < 1
        # Where the primary light is right already, a frame is nearer than its B alone.
        assert view["indirect"]["ssim"] < view["final"]["ssim"]
        for score in (view["indirect"], view["final"]):
            assert score["ssim"] <= score["ssim_ceiling"] + 0.01
    own, worst = report["held_out"]["scene_views"], report["held_out"]["worst"]
    assert [(view["name"], view["of_scene"]) for view in own] == [("front", True), ("corner", True)]
    assert worst["final"]["ssim"] == min(view["final"]["ssim"] for view in (*views, *own))
    assert [view["flags"] for view in own] == ["--camera front", "--camera corner"]
    for view in views:
        assert re.fullmatch(r"--eye \S+ --target \S+ --fov \d\S* --size 512x512", view["flags"])
        assert main.run(["render", CORNELL, "-o", str(baked / "view.png"), *view["flags"].split(), "-q"]) == 0
    log = (baked / "bake.log").read_text()
    assert f"worst view: {worst['name']}" in log
    assert (worst["flags"] in log) != worst["of_scene"]
    assert f"advice: {report['advice']['text']}\n" in log  # 64 Gaussians are few
    assert report["advice"]["bytes"] > report["bytes"]
    assert "irradiance" in log
    assert f"mean of {HELD_OUT} views: loss " in log


def test_a_bake_names_what_it_has_read(bakes):
    for folder in bakes.values():
        assert (folder / "c.gsgi.d").read_text() == f"{folder}/c.gsgi: \\\n  {CORNELL}\n"


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_same_bake_on_one_core_gives_the_same_bytes(bakes, tmp_path, operator):
    one_core = {"preexec_fn": lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})}
    options = [*FAST, "--operator", operator, "-q", "--no-evaluate"]
    done = run("-c", QUICK, "bake", CORNELL, "-o", tmp_path / "again.gsgi", *options, **one_core)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "again.gsgi").read_bytes() == (bakes[operator] / "c.gsgi").read_bytes()


def copied(cache: Path, folder: Path, *without: str) -> Path:
    """A copy in `folder` of a `cache`, but for what was kept of these stages."""
    shutil.copytree(cache, folder)
    for entry in entries(folder):
        if entry.stage in without:
            entry.path.unlink()
    return folder


@pytest.fixture(scope="module")
def traced(baked, tmp_path_factory) -> Path:
    """A cache of all that was traced for `baked`, without its fit."""
    return copied(baked / "cache", tmp_path_factory.mktemp("traced") / "cache", "fit")


@pytest.fixture
def quick(monkeypatch):
    """As QUICK, in this process, with even fewer samples."""
    for name in ("SAMPLES_FEWEST", "KNOWN_MOST"):
        monkeypatch.setattr(budget, name, 1 << 12)
    monkeypatch.setattr(chunks, "CHUNK", 1 << 11)
    monkeypatch.setattr(placement, "HELD_OUT", HELD_OUT)
    for name, value in (("SIZE", 64), ("SAMPLES", 256), ("GATHERED", 128)):
        monkeypatch.setattr(held_out, name, value)


@pytest.fixture
def turned(quick, traced, tmp_path, capsys):
    """A bake with options of the dial: its exit code, its report, its file, and what it said."""

    def run(*dial: str) -> tuple[int, dict, bytes, str]:
        output = tmp_path / "x.gsgi"
        command = ["bake", CORNELL, "-o", output, *SMALL, "--cache", traced, "--json", *dial]
        code = main.run(list(map(str, command)))
        said = capsys.readouterr()
        return code, json.loads(said.out), output.read_bytes(), said.err

    return run


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("more", [17, 719])
def test_a_file_of_at_most_so_many_bytes(turned, operator, more):
    size = file_bytes(operator, 1, Scene((), ())) + more
    code, report, data, _ = turned("--operator", operator, "--target-bytes", str(size), "-q")
    assert code == 0
    fits, exceeds = (file_bytes(operator, report["budget"] + i, Scene((), ())) for i in (0, 1))
    assert fits <= size < exceeds
    assert len(data) == report["bytes"] <= size
    read = codec.decode(data)
    assert len(read.gaussians) + len(read.coarse or ()) == report["gaussians"] <= report["budget"]
    assert len(report["attempts"]) == 1


def test_a_file_of_more_bytes_ends_with_6_and_is_written(turned, monkeypatch):
    size = file_bytes("surface", 12, Scene((), ()))
    monkeypatch.setattr(plan, "file_bytes", lambda *arguments: file_bytes(*arguments) // 3)
    code, report, data, said = turned("--target-bytes", str(size), "-q", "--no-evaluate")
    assert code == 6
    assert (report["bytes"], report["target_bytes"]) == (len(data), size)
    assert len(data) > size
    assert codec.decode(data).gaussians.position.any()
    closing, error = said.splitlines()
    assert closing.startswith("wrote ")
    fewer = report["gaussians"] * size // len(data)
    assert error.endswith(
        f"x.gsgi: the file has {len(data)} bytes, {len(data) / size - 1:.1%} more than --target-bytes {size}: "
        f"try --budget {fewer}"
    )


@pytest.mark.parametrize("operator", OPERATORS)
def test_no_gaussian_fits_the_bytes(capsys, tmp_path, operator):
    least = file_bytes(operator, 1, Scene((), ()))
    dial = "--operator", operator, "--target-bytes", least - 1
    line = refused(capsys, 1, "bake", CORNELL, "-o", tmp_path / "x.gsgi", "-q", *dial)
    assert f"--target-bytes {least - 1}: a file with one Gaussian may take {least}" in line
    assert not (tmp_path / "x.gsgi").exists()


@pytest.mark.parametrize("operator", OPERATORS)
def test_one_gaussian(turned, operator):
    code, report, data, _ = turned("--operator", operator, "--budget", "1", "-q")
    assert code == 0
    assert (report["budget"], report["gaussians"]) == (1, 1)
    assert len(data) <= file_bytes(operator, 1, Scene((), ()))


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_target_that_any_fit_meets_takes_one_try(turned, operator):
    code, report, data, said = turned("--operator", operator, "--target-loss", "0.99", "--budget", "600")
    assert code == 0
    (attempt,) = report["attempts"]
    assert attempt["gaussians"] == report["gaussians"] <= FEWEST < report["budget"]
    assert attempt["loss"] == pytest.approx(report["held_out"]["mean"]["loss"], rel=1e-6)
    assert attempt["loss"] < report["target_loss"] == 0.99
    assert attempt["bytes"] == len(data)
    assert f"{report['gaussians']} Gaussians, {len(data)} bytes: held-out loss {attempt['loss']:.4f}" in said


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_target_that_no_fit_meets_ends_with_6_and_the_best_file(turned, operator):
    code, report, data, said = turned("--operator", operator, "--target-loss", "1e-9", "--budget", "300", "-q")
    assert code == 6
    first, second = (attempt["gaussians"] for attempt in report["attempts"])
    assert 0 < first <= FEWEST < second <= 300
    best = min(report["attempts"], key=lambda attempt: attempt["loss"])
    assert (report["gaussians"], report["bytes"]) == (best["gaussians"], best["bytes"])
    read = codec.decode(data)
    assert len(read.gaussians) + len(read.coarse or ()) == best["gaussians"]
    assert best["loss"] == pytest.approx(report["held_out"]["mean"]["loss"], rel=1e-6)
    closing, error = said.splitlines()
    assert closing.startswith("wrote ")
    assert f"loss in held-out views is {best['loss']:.4f} at best, {best['loss'] / 1e-9 - 1:.0%} above the t" in error
    assert error.endswith(f"with {best['gaussians']} Gaussians: the budget is spent")


def test_pictures_of_the_fit_change_no_byte(quick, baked, traced, tmp_path):
    """Nor do silence and a report on stdout."""
    pictures, output = tmp_path / "pictures", tmp_path / "x.gsgi"
    command = ["bake", CORNELL, "-o", output, *FAST, *OVER, "--cache", traced, "-q", "--preview", pictures]
    assert main.run(list(map(str, command))) == 0
    assert output.read_bytes() == (baked / "c.gsgi").read_bytes()
    paths = sorted(pictures.iterdir(), key=lambda path: path.stem[-6:])
    assert [path.stem[-6:] for path in paths] == [f"{iteration:06d}" for iteration in (1, 2, 3, 4)]
    looks = json.loads((baked / "bake.json").read_text())["history"]
    assert [path.name for path in paths] == [f"fit-{k['gaussians']:06d}-{k['iteration']:06d}.png" for k in looks]
    assert read_image(paths[0]).shape == (2 * held_out.SIZE, HELD_OUT * held_out.SIZE, 3)


def test_a_preview_folder_that_cannot_be_made(baked, traced, capsys, tmp_path):
    command = ["bake", CORNELL, "-o", tmp_path / "x.gsgi", *FAST, *OVER, "--cache", traced, "-q"]
    line = refused(capsys, 2, *command, "--preview", baked / "c.gsgi" / "pictures")
    assert "cannot make the folder" in line
    assert not (tmp_path / "x.gsgi").exists()


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_looks_end_with_what_was_written(bakes, operator):
    report = json.loads((bakes[operator] / "bake.json").read_text())
    looks = report["history"]
    assert [look["iteration"] for look in looks] == [1, 2, 3, 4]
    assert looks[-1]["gaussians"] >= len(codec.decode((bakes[operator] / "c.gsgi").read_bytes()).gaussians)
    # 8 bits of each colour and opacity are left in the file; the surface operator solves for the colours at the end.
    rel = 0.05 if operator == "over" else 0.25
    assert looks[-1]["loss"] == pytest.approx(report["held_out"]["mean"]["loss"], rel=rel)
    assert report["target_loss"] is None
    assert report["budget"] == 64


def test_the_help_shows_accuracy_and_cost(capsys):
    for command in ("bake", "plan"):
        with pytest.raises(SystemExit):
            main.run([command, "--help"])
        _, _, rest = capsys.readouterr().out.partition("\naccuracy:\n")
        group = rest.partition("\n\n\n")[0]
        for word in (
            "--operator {surface,over}",
            "--quality {draft,medium,high}",
            "medium)",
            "--target-loss",
            "--budget",
            "--target-bytes",
        ):
            assert word in group


@pytest.mark.parametrize("operator", OPERATORS)
def test_render_reference_and_compare_speak_of_the_same_picture(bakes, tmp_path, gl, operator):
    size = ["--size", "48x40", "--camera", "corner"]
    frame, truth = tmp_path / "frame.exr", tmp_path / "truth.exr"
    assert gsgi("render", CORNELL, "--gi", bakes[operator] / "c.gsgi", "-o", frame, *size).returncode == 0
    assert gsgi("reference", CORNELL, "-o", truth, *size, "--samples", "256", "-q").returncode == 0
    run = gsgi("compare", frame, truth, "--json")
    assert run.returncode == 0, run.stderr
    difference = json.loads(run.stdout)
    assert set(difference) == {"psnr", "ssim", "flip", "shown_psnr"}
    assert difference["psnr"] > 15  # 64 Gaussians after four steps: the same picture, not yet a good one
    assert difference["ssim"] > 0.6
    assert "SSIM" in gsgi("compare", frame, truth).stdout


def test_render_says_what_each_pass_costs(bakes, tmp_path, gl, capsys):
    for operator, last in (("surface", "surface/read"), ("over", "over/splat")):
        frame = ["--gi", str(bakes[operator] / "c.gsgi"), "-o", str(tmp_path / "frame.png"), "--size", "16x16"]
        assert main.run(["render", CORNELL, *frame, "--profile"]) == 0
        names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
        assert names[1:3] == ["pass", "frame/gbuffer"]  # after the driver
        assert names[-3:] == [last, "frame/composite", "all"]


def test_render_says_when_the_light_is_of_another_scene(baked, tmp_path, gl):
    size = ["--gi", baked / "c.gsgi", "-o", tmp_path / "frame.png", "--size", "16x16"]
    said = gsgi("render", CORNELL, *size, "--quiet").stderr
    assert said.startswith(f"wrote {tmp_path / 'frame.png'}: final, 16 x 16 px, ")
    assert said.count("\n") == 1
    other = gsgi("render", SCENES / "two_rooms.glb", *size, "--quiet")
    assert other.returncode == 0
    warning, closing = other.stderr.splitlines()
    assert "other geometry" in warning
    assert closing.startswith("wrote ")


@pytest.mark.parametrize("layer", ["primary", "albedo", "normal", "depth"])  # those that no fit changes
def test_render_and_reference_agree_on_layers(baked, tmp_path, gl, layer):
    size = ["--size", "32x32", "--layer", layer]
    a, b = tmp_path / "a.exr", tmp_path / "b.exr"
    assert main.run(["render", CORNELL, "-o", str(a), *size]) == 0
    assert main.run(["reference", CORNELL, "-o", str(b), *size, "--samples", "2", "-q"]) == 0
    drawn, traced = read_image(a), read_image(b)
    assert drawn.shape == traced.shape
    # A pixel on an edge may see either side of it, and a shadow map blurs shadow edges.
    assert np.quantile(np.abs(drawn - traced), 0.9) < 0.01 * max(1, np.abs(traced).max())


@pytest.mark.parametrize("layer", ["primary", "albedo", "normal", "depth"])
def test_a_reference_traces_no_more_than_its_layer_needs(monkeypatch, capsys, tmp_path, layer):
    monkeypatch.setattr(Tracer, "indirect", lambda *_: pytest.fail(f"{layer} has no B in it"))
    command = ["reference", CORNELL, "-o", str(tmp_path / "x.exr"), "--size", "16x16", "--layer", layer]
    assert main.run([*command, "-q"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"wrote {tmp_path / 'x.exr'}: {layer}, 16 x 16 px, ")
    assert read_image(tmp_path / "x.exr").any()


@pytest.mark.parametrize("layer", ["indirect", "final"])
def test_a_denoiser_that_leaves_light_out_is_reported(monkeypatch, capsys, tmp_path, layer):
    command = ["reference", CORNELL, "-o", str(tmp_path / "x.exr"), "--size", "16x16", "--samples", "2", "--denoise"]
    for lost in (0.04, 0.31):
        monkeypatch.setattr("gsgi.baker.trace.reference.Reference.lost", lost)
        assert main.run([*command, "--layer", layer]) == 0
        assert ("left out 31% of the indirect light" in capsys.readouterr().err) == (lost == 0.31)


@pytest.mark.parametrize("command", [["render"], ["reference", "--samples", "2"]])
def test_a_camera_that_sees_nothing_is_said(capsys, tmp_path, gl, command):
    where = ["-o", str(tmp_path / "x.png"), "--size", "16x16", "--eye", "0,1,3", "--target"]
    for target, warnings in (("0,1,9", 1), ("0,1,0", 0)):
        assert main.run([*command, CORNELL, *where, target, "-q"]) == 0
        assert capsys.readouterr().err.count("the camera sees no surface: ") == warnings


def test_render_and_reference_write_the_normal_that_a_map_bends(tmp_path, gl):
    document, data = quad_scene()
    document["materials"][0]["normalTexture"] = {"index": 0}
    document["nodes"].append({"camera": 0, "translation": [0.5, 0.5, 1]})
    document["scenes"][0]["nodes"].append(1)
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}}]
    scene, size = str(write(tmp_path / "bumps.glb", document, data)), ["--size", "32x32", "--layer", "normal"]
    a, b = tmp_path / "a.exr", tmp_path / "b.exr"
    assert main.run(["render", scene, "-o", str(a), *size]) == 0
    assert main.run(["reference", scene, "-o", str(b), *size, "--samples", "2", "-q"]) == 0
    drawn, traced = read_image(a), read_image(b)
    assert np.quantile(np.abs(drawn - traced), 0.9) < 0.01
    assert traced.std(axis=(0, 1)).min() > 0.1


@pytest.mark.parametrize("sun", ["60,50", "200,70"])
def test_the_same_sun_reaches_render_and_reference(tmp_path, gl, sun):
    common = ["--size", "32x32", "--layer", "primary", "--camera", "above"]
    floor = write_floor(tmp_path / "floor.gltf")
    a, b = tmp_path / "a.exr", tmp_path / "b.exr"
    assert main.run(["render", str(floor), "-o", str(a), *common, "--sun", sun]) == 0
    (tmp_path / "floor.lights.toml").write_text(f"sun = [{sun}]")
    assert main.run(["reference", str(floor), "-o", str(b), *common, "--samples", "2", "-q"]) == 0
    drawn, traced = read_image(a), read_image(b)
    elevation = np.radians(float(sun.split(",")[1]))
    expected = 0.5 * 10 * np.sin(elevation) / np.pi  # albedo, irradiance, its cosine
    np.testing.assert_allclose(traced, expected, rtol=1e-5)
    np.testing.assert_allclose(drawn, expected, rtol=0.01)


def test_a_scene_without_light_is_lit_from_outside(quick, capsys, tmp_path):
    dark = write_floor(tmp_path / "dark.gltf")
    output = str(tmp_path / "x.gsgi")
    assert main.run(["bake", str(dark), "-o", output, *FAST, "-q"]) == 3
    assert "--env" in capsys.readouterr().err
    assert main.run(["bake", str(dark), "-o", output, *FAST, "-q", "--no-evaluate", "--env", "1,1,1"]) == 0
    gaussians = codec.decode(Path(output).read_bytes()).gaussians
    assert 0.5 < np.median(gaussians.sh[:, 0]) * 0.2820948 < 1.5  # B = 1 under an even sky


def test_png_output_is_a_picture(baked, tmp_path, gl):
    for layer in LAYERS:
        path = tmp_path / f"{layer}.png"
        options = ["--layer", layer, "--size", "20x12"]
        assert main.run(["render", CORNELL, "--gi", str(baked / "c.gsgi"), "-o", str(path), *options]) == 0
        image = read_image(path)
        assert image.shape == (12, 20, 3)
        assert image.max() > 0.2


def test_inspect_says_what_the_file_holds(baked):
    facts = json.loads(gsgi("inspect", baked / "c.gsgi", "--json").stdout)
    assert (facts["sh_degree"], facts["operator"]) == (0, "over")
    assert "punctual" in facts["effects"]
    assert "emissive" not in facts["effects"]
    assert "gaussians" in gsgi("inspect", baked / "c.gsgi").stdout
    assert not any("coarse" in name for name in facts)


def test_inspect_shows_both_levels_of_a_file_for_the_surface_operator(capsys):
    path = str(DATA / "v6_surface.gsgi")
    assert main.run(["inspect", path, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["version"], facts["operator"], facts["sharpness"]) == (6, "surface", 4)
    assert (facts["gaussians"], facts["sh_degree"]) == (3, 1)
    assert (facts["coarse_gaussians"], facts["coarse_sh_degree"]) == (2, 2)
    assert (facts["basis"], facts["coarse_basis"]) == ("linear", "constant")
    assert "alpha_min" not in facts
    assert main.run(["inspect", path]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(facts)
    assert len({len(line) - len(line[line.index("  ") :].lstrip()) for line in lines if "  " in line}) == 1


def test_help_answers_fast_and_shows_examples():
    best = {}
    for command in ([], *([module.__name__.rpartition(".")[2]] for module in COMMANDS)):
        times = []
        for _ in range(5):
            start = sum(os.times()[2:4])  # of children, user and system: tests share their machine
            run = gsgi(*command, "--help")
            times.append(sum(os.times()[2:4]) - start)
            assert run.returncode == 0
            assert ("examples:" in run.stdout) == bool(command)
            assert "exit codes" in run.stdout
            if times[-1] < 0.2:
                break
        best[" ".join(command)] = min(times)
    assert max(best.values()) < 0.2, best


def test_missing_input(capsys, tmp_path):
    assert "nowhere.glb" in refused(capsys, 2, "bake", tmp_path / "nowhere.glb", "-o", tmp_path / "x.gsgi")
    assert "nowhere.gsgi" in refused(capsys, 2, "inspect", tmp_path / "nowhere.gsgi")
    assert "nowhere.png" in refused(capsys, 2, "compare", tmp_path / "nowhere.png", tmp_path / "nowhere.png")


def test_a_folder_as_input(capsys, tmp_path):
    assert str(tmp_path) in refused(capsys, 2, "bake", tmp_path, "-o", tmp_path / "x.gsgi")
    assert str(tmp_path) in refused(capsys, 2, "inspect", tmp_path)


def test_a_truncated_glb(capsys, tmp_path):
    broken = tmp_path / "broken.glb"
    broken.write_bytes(Path(CORNELL).read_bytes()[:-100])
    assert "broken.glb" in refused(capsys, 3, "bake", broken, "-o", tmp_path / "x.gsgi")
    assert not (tmp_path / "x.gsgi").exists()


def test_an_empty_scene_and_a_scene_without_light(capsys, tmp_path):
    empty = tmp_path / "empty.gltf"
    empty.write_text('{"asset": {"version": "2.0"}}')
    assert "triangle" in refused(capsys, 3, "bake", empty, "-o", tmp_path / "x.gsgi")
    dark = tmp_path / "dark.glb"
    data = Path(CORNELL).read_bytes().replace(b"KHR_lights_punctual", b"XYZ_lights_punctual")
    dark.write_bytes(data)
    assert main.run(["bake", str(dark), "-o", str(tmp_path / "x.gsgi"), "-q"]) == 3
    assert "no light" in capsys.readouterr().err
    assert not (tmp_path / "x.gsgi").exists()


def test_an_unknown_camera_is_named_with_those_that_exist(capsys, tmp_path):
    line = refused(capsys, 1, "render", CORNELL, "-o", tmp_path / "x.png", "--camera", "roof")
    assert "'roof'" in line
    assert "front" in line


def test_a_gsgi_file_cut_in_half(capsys, baked, tmp_path):
    half = tmp_path / "half.gsgi"
    data = (baked / "c.gsgi").read_bytes()
    half.write_bytes(data[: len(data) // 2])
    assert "half.gsgi: byte" in refused(capsys, 3, "inspect", half)
    assert "half.gsgi" in refused(capsys, 3, "render", CORNELL, "--gi", half, "-o", tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()


def test_a_loop_of_links_is_no_output(capsys, tmp_path):
    loop = tmp_path / "loop.gsgi"
    loop.symlink_to(loop)
    assert "links" in refused(capsys, 2, "bake", CORNELL, "-o", loop)


def test_an_unwritable_output_is_refused_before_any_work(capsys, tmp_path):
    start = time.perf_counter()
    for output in (tmp_path / "no" / "folder.gsgi", tmp_path, Path("/proc/x.gsgi")):
        assert str(output) in refused(capsys, 2, "bake", CORNELL, "-o", output)
    assert time.perf_counter() - start < 5
    assert list(tmp_path.iterdir()) == []


def test_images_of_different_size_or_kind_are_not_compared(capsys, tmp_path):
    a, b, c = (str(tmp_path / name) for name in ("a.png", "b.png", "c.exr"))
    write_image(a, np.zeros((16, 16, 3), np.uint8))
    write_image(b, np.zeros((16, 20, 3), np.uint8))
    write_image(c, np.zeros((16, 16, 3), np.float32))
    line = refused(capsys, 1, "compare", a, b)
    assert "16x16" in line
    assert "20x16" in line
    refused(capsys, 1, "compare", a, c)
    assert ".glb" in refused(capsys, 1, "compare", a, CORNELL)


def test_osmesa_has_no_devices(capsys, tmp_path):
    line = refused(capsys, 1, "render", CORNELL, "-o", tmp_path / "x.png", "--backend", "osmesa", "--device", 0)
    assert "--device" in line


WRONG_DIALS = (
    *(
        ["--operator", "under"],
        ["--quality", "best"],
        ["--gaussians", "64"],
        ["--preview"],
        ["--budget", "9", "--target-bytes", "9000"],
    ),
    *(["--target-loss", "0"], ["--target-loss", "-1"], ["--target-loss", "nan"], ["--target-loss", "inf"]),
    *(["--target-bytes", "0"], ["--target-bytes", "1e5"], ["--budget", "-1"], ["--budget", "16777217"]),
)


@pytest.mark.parametrize(
    "arguments",
    [
        *[[], ["fly"], ["bake"], ["bake", "x.glb"], ["render", "x.glb", "-o", "y.png", "--size", "0x5"]],
        *[["bake", "x.glb", "-o", "y.gsgi", "--budget", "0"], ["bake", "x.glb", "-o", "y.gsgi", "--views", "two"]],
        *[["bake", "x.glb", "-o", "y.gsgi", *dial] for dial in WRONG_DIALS],
        *[["render", "x.glb", "-o", "y.png", "--layer", "fog"], ["render", "x", "-o", "y.png", "--exposure", "nan"]],
    ],
)
def test_a_wrong_command_line_exits_with_1(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main.run(arguments)
    assert stop.value.code == 1
    assert "gsgi: " in capsys.readouterr().err


def test_an_unknown_image_type_is_refused(capsys, tmp_path):
    start = time.perf_counter()
    for command in ("render", "reference"):
        assert ".png" in refused(capsys, 1, command, CORNELL, "-o", tmp_path / "x.tiff")
    assert time.perf_counter() - start < 5  # before any work


def test_a_bake_never_overwrites_its_scene(capsys, tmp_path):
    scene = tmp_path / "room.glb"
    scene.write_bytes(Path(CORNELL).read_bytes())
    assert "overwrite" in refused(capsys, 1, "bake", scene, "-o", scene)
    assert scene.read_bytes() == Path(CORNELL).read_bytes()


def test_a_bake_never_overwrites_a_file_of_its_scene(capsys, tmp_path):
    sky = tmp_path / "sky.exr"
    write_image(str(sky), np.ones((8, 16, 3), np.float32))
    before = sky.read_bytes()
    assert "overwrite" in refused(capsys, 1, "bake", CORNELL, "--env", sky, "-q", "-o", sky)
    assert "overwrite" in refused(capsys, 1, "reference", CORNELL, "--env", sky, "-q", "-o", sky)
    assert sky.read_bytes() == before


def test_an_export_never_overwrites_a_scene(capsys, tmp_path, baked):
    scene, splats = tmp_path / "room.glb", tmp_path / "splats.glb"
    scene.write_bytes(Path(CORNELL).read_bytes())
    assert "overwritten" in refused(capsys, 1, "export", baked / "c.gsgi", "-o", scene)
    assert scene.read_bytes() == Path(CORNELL).read_bytes()
    for _ in range(2):  # its own files may be written again
        assert main.run(["export", str(baked / "c.gsgi"), "-q", "-o", str(splats)]) == 0


def test_an_update_names_the_file_that_is_none(capsys, tmp_path):
    line = refused(capsys, 3, "bake", CORNELL, "-q", "-o", tmp_path / "x.gsgi", "--update", CORNELL)
    assert line.startswith(f"gsgi: {CORNELL}: byte 0 (magic)")


def test_light_that_is_not_that_of_the_bake_is_said(baked, tmp_path, gl):
    size = ["--gi", baked / "c.gsgi", "-o", tmp_path / "frame.png", "--size", "16x16", "--quiet"]
    said = gsgi("render", CORNELL, "--env", "1,1,1", *size).stderr.splitlines()
    assert any("was baked without an environment" in line and "cornell.lights.toml" in line for line in said)


def test_a_comparison_can_fail(capsys, tmp_path):
    files = [str(tmp_path / name) for name in ("a.png", "b.png")]
    rng = np.random.default_rng(0)
    for file in files:
        write_image(file, rng.integers(0, 255, (32, 32, 3)).astype(np.uint8))
    for limits, code in (([], 0), (["--min-ssim", "0.9"], 6), (["--max-flip", "0.01"], 6), (["--max-flip", "1"], 0)):
        assert main.run(["compare", *files, *limits]) == code
        assert ("is below 0.9" in capsys.readouterr().err) == ("--min-ssim" in limits)


def test_baked_light_that_is_asked_for_must_exist(capsys, tmp_path):
    refused(capsys, 2, "render", CORNELL, "--gi", "", "-o", tmp_path / "x.png")
    assert "--gi" in refused(capsys, 1, "render", CORNELL, "--layer", "indirect", "-o", tmp_path / "x.png")


def test_a_full_disk_behind_stdout_is_no_traceback(baked):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "gsgi.baker", "inspect", str(baked / "c.gsgi")]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert run.returncode == 2
    assert run.stderr.startswith("gsgi: cannot write the output: No space left")
    assert run.stderr.count("\n") == 1


def test_the_version_is_told():
    assert gsgi("--version").stdout.startswith("gsgi 0.")


def test_an_llvm_that_does_not_work_is_named(tmp_path):
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": "/nonexistent.so"}
    run = gsgi("reference", CORNELL, "-o", tmp_path / "x.png", "-q", env=environment)
    assert run.returncode == 5
    assert run.stderr.startswith("gsgi: /nonexistent.so")
    assert run.stderr.count("\n") == 1


TRACED = ("surface", "free", "layer", "coarse", "fit")
# After a stage of a bake: the stages of the cache that follow it.
AFTER = {
    "scene": None,
    "plan": ("known", "reference", *TRACED),
    "references": TRACED,
    "irradiance": ("fit",),
    "wrote": (),
}


@pytest.mark.parametrize("stage", AFTER)
def test_ctrl_c_ends_with_130_within_two_seconds_at_any_stage(bakes, tmp_path, stage):
    """A fifth of a second after the line of a `stage`, or at once after the last. What comes before is in the cache."""
    out, cache = tmp_path / "out", tmp_path / "cache"
    out.mkdir()
    if AFTER[stage] is not None:
        copied(bakes["surface"] / "cache", cache, *AFTER[stage])
    command = [sys.executable, "-c", QUICK, "bake", CORNELL, "-o", str(out / "x.gsgi"), *FAST]
    command += ["--cache", str(cache), "--iterations", "4" if stage == "wrote" else "1000000"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while not (line := process.stderr.readline()).startswith(stage):
        assert line, "the bake ended early"
    time.sleep(0 if stage == "wrote" else 0.2)
    start = time.perf_counter()
    os.killpg(process.pid, signal.SIGINT)
    _, log = process.communicate(timeout=60)
    assert time.perf_counter() - start < 2
    assert process.returncode == 130, log
    assert log.endswith("gsgi: interrupted\n")
    assert [path.name for path in out.iterdir()] == (["x.gsgi"] if stage == "wrote" else [])
    assert not cache.exists() or all(path.suffix == ".gsgi-task" for path in cache.iterdir())


LONG_CALL = """
import hashlib, sys
from gsgi.baker.cli import main
from gsgi.baker.cli.commands import doctor
from gsgi.runtime.atomic import replacing
def run(options):
    with replacing(sys.argv[2]) as temporary:
        temporary.write_bytes(b"half")
        print("now", file=sys.stderr, flush=True)
        hashlib.pbkdf2_hmac("sha256", b"", b"", 1 << 30)  # minutes
doctor.run = run
main.PATIENCE = float(sys.argv[3])
main.main([sys.argv[1]])
"""


def interrupted_call(folder: Path, *signals: int, patience: float = main.PATIENCE) -> tuple[int, str]:
    """Exit code and last words of a command that has half a file in `folder` and does not come back from a call."""
    command = [sys.executable, "-c", LONG_CALL, "doctor", str(folder / "x.bin"), str(patience)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "now\n"
    start = time.perf_counter()
    for number in signals:
        process.send_signal(number)
        time.sleep(0.1)  # two signals at once are one
    _, log = process.communicate(timeout=60)
    assert time.perf_counter() - start < 2
    assert list(folder.iterdir()) == []
    return process.returncode, log


def test_an_interrupt_waits_for_no_call_into_a_library(tmp_path):
    assert interrupted_call(tmp_path, signal.SIGINT) == (130, "gsgi: interrupted\n")
    assert interrupted_call(tmp_path, signal.SIGTERM) == (143, "gsgi: terminated\n")


def test_a_second_ctrl_c_ends_at_once(tmp_path):
    assert interrupted_call(tmp_path, signal.SIGINT, signal.SIGINT, patience=600) == (130, "gsgi: interrupted\n")


LOST = """
import os, signal, sys
from gsgi.baker.cli import main
from gsgi.baker.cli.commands import doctor
def run(options):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        while True:
            pass
    except BaseException:
        if sys.argv[2] == "error":
            raise ImportError("initialization failed") from None
        return int(sys.argv[2])
doctor.run = run
main.main([sys.argv[1]])
"""


@pytest.mark.parametrize("code", ["0", "6", "error"])
def test_ctrl_c_counts_where_a_library_loses_it(code):
    command = [sys.executable, "-c", LOST, "doctor", code]
    run = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert (run.returncode, run.stderr) == (130, "gsgi: interrupted\n")


def test_a_full_disk_behind_the_output_is_named(traced, capsys, monkeypatch, small_disk):
    from gsgi.baker import bake

    monkeypatch.setattr(bake, "bake", lambda *_: SimpleNamespace(data=bytes(1 << 20), attempt=SimpleNamespace(count=1)))
    output = small_disk / "x.gsgi"
    output.write_bytes(b"old")
    arguments = ["-o", str(output), *FAST, "--cache", str(traced), "-q", "--no-evaluate"]
    assert main.run(["bake", CORNELL, *arguments]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"gsgi: {output}: cannot write: No space left on device")
    assert line.endswith(f"on the disk at {small_disk}\n")
    assert [(path.name, path.read_bytes()) for path in small_disk.iterdir()] == [("x.gsgi", b"old")]


def test_another_fit_takes_the_views_from_the_cache(baked, tmp_path):
    shutil.copytree(baked / "cache", tmp_path / "cache")
    options = [*FAST, *OVER, "--cache", tmp_path / "cache", "--budget", "65", "--iterations", "5", "--denoise", "off"]
    options.append("--no-evaluate")
    run = gsgi("bake", CORNELL, "-o", tmp_path / "x.gsgi", *options)
    assert run.returncode == 0, run.stderr
    assert "\n2 of 2 views from the cache\n" in run.stderr
    assert 32 < len(codec.decode((tmp_path / "x.gsgi").read_bytes()).gaussians) <= 65


@pytest.mark.parametrize(
    ("operator", "traced"),
    [
        ("over", {"view": 2}),
        (
            "surface",
            {"known": 2, "surface": 2 + 3, "free": 1, "layer": 3 + 3, "coarse": 1, "spots": 1},
        ),  # 3: known light
    ],
)
def test_the_cache_says_what_it_holds_and_can_be_emptied(bakes, capsys, tmp_path, operator, traced):
    folder = tmp_path / "cache"
    shutil.copytree(bakes[operator] / "cache", folder)
    assert main.run(["cache", "--cache", str(folder), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["folder"] == str(folder)
    assert facts["entries"] == len(list(folder.iterdir()))
    assert facts["bytes"] == sum(path.stat().st_size for path in folder.iterdir())
    assert facts["limit"] == 4 << 30
    stages = {stage: sums["entries"] for stage, sums in facts["stages"].items()}
    assert stages.pop("points") >= 1  # the pilot's
    # `baked` and `parts` are the record for a bake after an edit; two references are those of the scene's cameras.
    once = dict.fromkeys(("baked", "parts", "bounces", "fit", "placement"), 1)
    assert stages == {**once, "reference": HELD_OUT + 2, **traced}
    assert main.run(["cache", "--cache", str(folder), "--clear"]) == 0
    assert "entries     0" in capsys.readouterr().out
    assert list(folder.iterdir()) == []


def test_a_limit_that_makes_no_sense_is_refused(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("GSGI_CACHE_LIMIT", "plenty")
    assert "'plenty'" in refused(capsys, 1, "cache")
    assert "'plenty'" in refused(capsys, 1, "bake", CORNELL, "-o", tmp_path / "x.gsgi")


def test_doctor_names_every_part():
    run = gsgi("doctor", "--json")
    report = json.loads(run.stdout)
    checks = {check["name"]: check for check in report["checks"]}
    assert {"EGL", "OSMesa", "LLVM", "Mitsuba", "Open3D", "kernels", "denoiser", "decoders", "CUDA"} <= set(checks)
    assert report["bakes"] == all(c["works"] for c in checks.values() if c["needed_for"] == "bakes")
    assert report["frames"] == (checks["EGL"]["works"] or checks["OSMesa"]["works"])
    assert run.returncode == (0 if report["bakes"] and report["frames"] else 5)
    assert all(check["works"] or check["advice"] for check in checks.values())
