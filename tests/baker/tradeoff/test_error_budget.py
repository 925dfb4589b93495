"""The error budget: each cause of the default bake's error alone."""

import pytest

from gsgi.baker.evaluation.metrics import psnr
from gsgi.baker.surface import budget
from gsgi.baker.tradeoff import gaussians, report, study


@pytest.fixture(scope="module")
def made(ground):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budget, "SAMPLES_FEWEST", 1 << 13)
        patch.setattr(budget, "FREE_PER_GAUSSIAN", 64)
        patch.setattr(gaussians, "FACTORS_QUICK", (1, 4))
        patch.setattr(study, "ROUNDS_QUICK", 1)
        yield study.run(ground, [gaussians.SURFACE], (96, 64))


@pytest.fixture(scope="module")
def parts(made) -> dict[str, dict]:
    return {part["part"]: part for part in made.error_budget["parts"]}


def test_every_cause_is_there(parts):
    assert list(parts) == [
        "tracing noise", "quantisation", "no coarse level", "number of Gaussians", "1/2 resolution of the pass",
        "1/4 resolution of the pass", "shadow maps of primary light",
    ]  # fmt: skip


def test_what_is_read_on_the_processor_is_what_the_pass_draws(made, parts):
    default = next(entry for entry in made.entries if entry.scale == 1)
    assert parts["quantisation"]["ssim"] == pytest.approx(default.mean.ssim, abs=1e-3)
    assert parts["quantisation"]["psnr"] == pytest.approx(default.mean.psnr, abs=0.3)


def test_taking_a_cause_away_helps_or_does_no_harm(parts):
    assert parts["number of Gaussians"]["psnr_without"] > parts["number of Gaussians"]["psnr"]
    for name, part in parts.items():
        another_fit = name in ("tracing noise", "number of Gaussians")  # with so few samples, fits differ by some 0.003
        assert part["ssim_without"] > part["ssim"] - (5e-3 if another_fit else 2e-3), part


def test_exact_shadows_and_exact_indirect_light_are_the_reference(parts):
    shadows = parts["shadow maps of primary light"]
    assert shadows["ssim"] < shadows["ssim_without"] == pytest.approx(1, abs=1e-5)
    assert shadows["psnr"] < shadows["psnr_without"] <= psnr(0)


def test_the_page_shows_it(made, tmp_path):
    data = report.write(made, tmp_path, "cornell.glb", "")
    assert [part["part"] for part in data["error_budget"]["parts"]] == [
        part["part"] for part in made.error_budget["parts"]
    ]
    assert all(entry["command"].startswith("gsgi bake cornell.glb") for entry in data["entries"])
