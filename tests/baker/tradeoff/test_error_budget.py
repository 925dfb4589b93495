"""The error budget: each cause of the default bake's error alone."""

import csv
import io
import re

import pytest

from gsgi.baker.evaluation.metrics import psnr
from gsgi.baker.surface import budget
from gsgi.baker.tradeoff import gaussians, report, study


@pytest.fixture(scope="module")
def ground(ground_of):
    """With steps enough to tell a cause from chance: after 24, two fits of so few Gaussians differed by 0.01.

    Of the views of seeds 0 to 5, those of seed 0 are the hardest, and fits differ most in them.
    """
    return ground_of(iterations=120, seed=3)


@pytest.fixture(scope="module")
def made(ground):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budget, "SAMPLES_FEWEST", 1 << 14)
        patch.setattr(budget, "KNOWN_MOST", 1 << 14)
        patch.setattr(budget, "FREE_PER_GAUSSIAN", 64)
        patch.setattr(gaussians, "FACTORS_QUICK", (1, 4))
        patch.setattr(study, "ROUNDS_QUICK", 1)
        yield study.run(ground, [gaussians.SURFACE._replace(paths=(2.0,))], (96, 64))


@pytest.fixture(scope="module")
def parts(made) -> dict[str, dict]:
    return {part["part"]: part for part in made.error_budget["parts"]}


def test_every_cause_is_there(parts):
    assert list(parts) == [
        "tracing noise", "number of Gaussians", "1/2 resolution of the pass", "1/4 resolution of the pass",
        "quantisation", "no coarse level", "shadow maps of primary light",
    ]  # fmt: skip


def test_what_is_read_on_the_processor_is_what_the_pass_draws(made, parts):
    default = next(entry for entry in made.entries if entry.scale == 1)
    assert parts["quantisation"]["ssim"] == pytest.approx(default.mean.ssim, abs=1e-3)
    assert parts["quantisation"]["psnr"] == pytest.approx(default.mean.psnr, abs=0.3)


def test_taking_a_cause_away_helps_or_does_no_harm(parts):
    assert parts["number of Gaussians"]["psnr_without"] > parts["number of Gaussians"]["psnr"]
    # With so few samples, fits differ by some 0.003. With so few Gaussians, coarse ones fill gaps, and their colours
    # come in steps of 3 %: rounding brought a view's mean light from 0.4747 to 0.4792, where the reference has 0.5302.
    by_chance = "tracing noise", "number of Gaussians", "quantisation"
    for name, part in parts.items():
        assert part["ssim_without"] > part["ssim"] - (5e-3 if name in by_chance else 2e-3), part


def test_exact_shadows_and_exact_indirect_light_are_the_reference(parts):
    shadows = parts["shadow maps of primary light"]
    assert shadows["ssim"] < shadows["ssim_without"] == pytest.approx(1, abs=1e-5)
    assert 70 < shadows["psnr_without"] <= psnr(0)
    assert shadows["psnr"] < shadows["psnr_without"] + 1  # both may be what the references' noise lets one tell


@pytest.fixture(scope="module")
def written(made, tmp_path_factory):
    """The folder of the study's files, and its data."""
    folder = tmp_path_factory.mktemp("study")
    return folder, report.write(made, folder, "cornell.glb", "", "gsgi bake cornell.glb -o cornell.gsgi")


def test_the_page_shows_it(made, written):
    _, data = written
    assert [part["part"] for part in data["error_budget"]["parts"]] == [
        part["part"] for part in made.error_budget["parts"]
    ]


def test_commands_bake_what_was_measured(written, ground):
    _, data = written
    full = {entry["paths"]: entry["command"] for entry in data["entries"] if entry["value"] == 64}
    assert full[1] == "gsgi bake cornell.glb -o cornell.gsgi --budget 64"
    assert full[2] == f"{full[1]} --samples {2 * ground.plan.settings.samples} --error 0.0354"


def test_the_time_of_each_stage_is_shown_against_the_error(written):
    folder, data = written
    page, plot = ((folder / name).read_text() for name in (report.PAGE, "time.svg"))
    assert plot.strip() in page
    ours = [i for i, entry in enumerate(data["entries"]) if entry["scale"] == 1]
    assert [data["entries"][i]["label"] for i in ours] == [
        "64 Gaussians", "256 Gaussians", "64 Gaussians, 2 times the paths",
    ]  # fmt: skip
    dots = [int(place) for place in re.findall(r'data-entry="(\d+)"', plot)]
    assert sorted(dots) == sorted([*ours, 0])  # the default bake is on both curves
    for i in ours:
        entry = data["entries"][i]
        assert set(entry["seconds"]) == {"views", "plan", "known light", "irradiance", "fit", "encode"}
        assert f"{entry['bake_seconds']:.3g} s, SSIM {entry['mean']['ssim']:.4f}" in plot
    rows = list(csv.DictReader(io.StringIO((folder / "study.csv").read_text())))
    for row, entry in zip(rows, data["entries"], strict=True):
        assert float(row["seconds_known_light"]) == entry["seconds"]["known light"]


def test_light_that_was_kept_counts_with_the_seconds_that_it_took(made):
    """Bakes of all budgets end in the same known light, which is traced for the first of them."""
    known = {entry.seconds["known light"] for entry in made.entries}
    assert max(known) < 1.2 * min(known) + 0.2
