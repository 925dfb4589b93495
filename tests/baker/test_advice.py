"""Advice where a bake differs visibly: when it is given, what it says to turn, and what that costs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gsgi.baker import advice
from gsgi.baker.advice import MORE, advise, falls_short
from gsgi.baker.evaluation.comparison import Comparison
from gsgi.baker.evaluation.held_out import Evaluation, ViewEvaluation
from gsgi.baker.plan import file_bytes
from gsgi.baker.settings import BUDGET_MAX, Settings
from gsgi.runtime.scene import Environment, Scene

SCENE = Scene((), ())
DETAIL, DRAFT, MEDIUM, HIGH = 16000, 900, 3600, 14400  # of the scene, and Gaussians of each quality for it


def view(ssim=0.99, ceiling=0.995, mottle=0.01, name="placed 1", **marks) -> ViewEvaluation:
    score = Comparison(40.0, ssim, ceiling, 0.05, 40.0)
    return ViewEvaluation(name, 0.01, score, score, mottle, **marks)


def advised(*views: ViewEvaluation, by_light=1.0, scene=SCENE, **settings) -> advice.Advice | None:
    made = Settings(**{"budget": MEDIUM, "samples": 192} | settings)
    return advise(
        SimpleNamespace(
            settings=made,
            placement=SimpleNamespace(importance=None),
            groups=[],
            scene=scene,
            gaussians=lambda budget: round(by_light * budget),
        ),
        Evaluation(list(views), None, [], None),
    )


@pytest.fixture(autouse=True)
def detail(monkeypatch):
    monkeypatch.setattr(advice, "gaussians_for", lambda seen: DETAIL)


@pytest.mark.parametrize(
    ("found", "short"),
    [
        (view(), False),
        (view(mottle=None), False),
        (view(ssim=0.969), True),
        (view(ssim=0.972, ceiling=0.993), True),
        (view(mottle=0.016), True),
        (view(ssim=0.96, ceiling=0.955), False),  # nothing can be known to be closer
        (view(ssim=0.5, noisy=True), False),
    ],
)
def test_a_view_falls_short_where_one_sees_it(found, short):
    assert falls_short(found) == short
    assert (advised(found) is not None) == (short or found.noisy)
    assert (advised(view(), found) is not None) == short


def test_the_next_quality_and_its_bytes():
    found = advised(view(), view(ssim=0.95), view(ssim=0.93, name="door", of_scene=True, mottle=0.02))
    assert (found.view, found.option, found.gaussians, found.samples) == ("door", "--quality high", HIGH, 768)
    assert found.bytes == file_bytes("surface", HIGH, SCENE)
    assert found.text == (
        "door (camera of the scene) differs visibly from path tracing, SSIM 0.9300 (ceiling 0.9950), mottle 2.0%: "
        f"try --quality high (at most {found.bytes} bytes) or --samples 768 (4 times the paths)"
    )
    assert advised(view(ssim=0.9), quality="draft", budget=DRAFT).option == "--quality medium"


def test_mottle_comes_first_where_it_alone_falls_short():
    found = advised(view(mottle=0.02), view(ssim=0.994, mottle=0.03, name="placed 2"), view(ssim=0.98))
    assert found.text.startswith(
        "placed 2 is blotched by 3.0% where its light is smooth (mottle), SSIM 0.9940 (ceiling 0.9950): "
        "try --quality high"
    )


def test_a_view_that_is_not_the_worst_can_be_looked_at():
    found = advised(view(0.98), view(0.99, mottle=0.03, name="placed 2", flags="--eye 1,2,3"))
    assert found.text.endswith("(4 times the paths); `gsgi render` shows it with --eye 1,2,3")
    found = advised(view(0.98), view(0.99, mottle=0.03, name="hall", flags="--camera hall", of_scene=True))
    assert found.text.endswith("(4 times the paths)")


def test_the_next_quality_has_more_where_light_calls_for_more():
    found = advised(view(ssim=0.9), by_light=1.5)
    assert (found.option, found.gaussians) == ("--quality high", 1.5 * HIGH)


@pytest.mark.parametrize("settings", [{"budget": 500}, {"quality": "high", "budget": HIGH}])
def test_a_budget_of_ones_own_is_enlarged(settings):
    found = advised(view(ssim=0.9), **settings)
    assert found.gaussians == MORE * settings["budget"]
    assert found.option == f"--budget {found.gaussians}"


def test_the_largest_budget_leaves_the_samples():
    found = advised(view(ssim=0.9), budget=BUDGET_MAX)
    assert (found.option, found.gaussians, found.bytes) == (None, None, None)
    assert found.text.endswith(": try --samples 768 (4 times the paths)")


def test_a_search_is_given_a_smaller_target():
    found = advised(view(ssim=0.9), target_loss=0.01)
    assert (found.option, found.bytes) == ("--target-loss 0.005", None)


def test_where_no_view_can_be_judged_light_may_be_missing():
    noisy = view(ssim=0.5, ceiling=0.5, noisy=True), view(ssim=0.5, ceiling=0.4, noisy=True, name="door", of_scene=True)
    found = advised(*noisy)
    assert (found.view, found.option, found.samples, found.bytes) == ("door", "--env 1,1,1", 768, None)
    assert "light the scene by a sky (--env 1,1,1), or try --samples 768 (4 times the paths)" in found.text
    lit = replace(SCENE, environment=Environment(np.ones((1, 2, 3), np.float32)))
    assert advised(*noisy, scene=lit).option is None
    assert advised(*noisy, view()) is None
    assert advised() is None
