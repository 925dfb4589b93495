"""Bakes with a deadline: which settings fit into a time, and that others repeat the bake."""

import json
from itertools import pairwise
from types import SimpleNamespace

import pytest
from repository import SCENES
from small_tasks import place_quickly

from gsgi.baker import deadline
from gsgi.baker.cli.main import run
from gsgi.baker.deadline import LADDER, LONGER, PARTS, fitting, longest, rungs
from gsgi.baker.estimate import Rates
from gsgi.baker.settings import BUDGET_MAX
from gsgi.baker.surface import budget, chunks

CORNELL = str(SCENES / "cornell.glb")
SMALL = ["--views", "2", "--view-size", "24", "--samples", "64", "--bounces", "2", "--no-evaluate", "--quiet"]


def takes(rung) -> float:
    """Seconds of a rung on a machine that does not exist."""
    return 2 + rung.budget * (0.1 / rung.error + 0.05 * rung.iterations) / 1000


def test_the_ladder_rises_from_the_cheapest_to_the_best():
    ladder = rungs(1000)
    assert len(ladder) == PARTS * (len(LADDER) - 1) + 1
    assert ladder[::PARTS] == [(round(factor * 1000), error, steps) for factor, error, steps in LADDER]
    for one, next_one in pairwise(ladder):
        assert one != next_one
        assert one.budget <= next_one.budget
        assert one.error >= next_one.error
        assert one.iterations <= next_one.iterations
    assert rungs(1)[0].budget == 1
    assert rungs(BUDGET_MAX)[-1].budget == BUDGET_MAX


def test_the_best_that_fits_is_chosen_and_fills_the_time():
    ladder = rungs(1000)
    least, most = takes(ladder[0]), takes(longest(ladder[-1]))
    chosen = [fitting(ladder, takes, least + i / 200 * (most - least)) for i in range(201)]
    for i, rung in enumerate(chosen):
        left = least + i / 200 * (most - least)
        assert 0.9 * left < takes(rung) <= left + 1e-9
    order = [(rung.budget, -rung.error) for rung in chosen]
    assert order == sorted(order)
    assert chosen[-1] == longest(ladder[-1])


def test_too_little_time_gives_the_cheapest_and_too_much_the_best():
    ladder = rungs(1000)
    assert fitting(ladder, takes, -5.0) == ladder[0]
    assert fitting(ladder, takes, 1e9) == ladder[-1]._replace(iterations=LONGER * LADDER[-1][2])


@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        (["--budget", "99"], "not allowed with argument"),
        (["--target-bytes", "9999"], "not allowed with argument"),
        (["--quality", "high"], "seconds: it decides the quality"),
        (["--target-loss", "0.1"], "seconds: it decides the target loss"),
        (["--error", "0.1"], "seconds: it decides the error"),
        (["--iterations", "10"], "seconds: it decides the iterations"),
        (["--operator", "over"], "seconds: expected the operator surface, got over"),
    ],
)
def test_what_contradicts_a_deadline_is_refused(flags, reason, capsys):
    try:
        code = run(["plan", CORNELL, "--seconds", "60", *flags])
    except SystemExit as ended:  # what argparse refuses
        code = ended.code
    assert code == 1
    told = capsys.readouterr().err
    assert reason in told
    assert told.count("\n") == 1


@pytest.fixture
def quick(monkeypatch):
    """Small bakes, on a machine on which a step of the fit takes a second and everything else nothing."""
    place_quickly(monkeypatch.setattr)
    chunk = 1 << 10
    monkeypatch.setattr(budget, "SAMPLES_FEWEST", chunk + 1)
    monkeypatch.setattr(budget, "KNOWN_MOST", 2 * chunk)
    monkeypatch.setattr(budget, "FREE_PER_GAUSSIAN", 4)
    monkeypatch.setattr(chunks, "CHUNK", chunk)
    monkeypatch.setattr(deadline, "LADDER", ((1 / 64, 0.2, 2), (1 / 32, 0.1, 4)))
    _machine(monkeypatch, 1000.0)


def _machine(monkeypatch, step: float) -> None:
    """Let each step of a fit take so many seconds."""

    def seconds(plan, evaluate=True) -> dict[str, float]:
        return {"known light": 9e3, "fit": step * plan.settings.iterations, "evaluation": 500.0 * evaluate}

    monkeypatch.setattr(Rates, "timed", lambda plan: SimpleNamespace(seconds=seconds))


def bake(tmp_path, name: str, *flags: str) -> bytes:
    """The file of a small bake with the flags."""
    output = tmp_path / name
    assert run(["bake", CORNELL, "-o", str(output), *SMALL, *flags, "--json"]) == 0
    return output.read_bytes()


def test_a_bake_with_a_deadline_is_repeated_by_its_flags(quick, monkeypatch, tmp_path, capsys):
    cache = ["--cache", str(tmp_path / "cache")]
    data = bake(tmp_path, "timed.gsgi", "--seconds", "4200", *cache)
    told = capsys.readouterr()
    decided = json.loads(told.out)["deadline"]
    assert decided["seconds"] == 4200
    assert 3 <= int(decided["flags"].split()[-1]) <= 4  # 4,200 s, less what was spent before
    again = bake(tmp_path, "again.gsgi", *decided["flags"].split(), "--cache", str(tmp_path / "another"))
    assert again == data
    assert json.loads(capsys.readouterr().out)["deadline"] is None

    # A machine that is slower now goes on with what was decided.
    _machine(monkeypatch, 2000.0)
    assert bake(tmp_path, "resumed.gsgi", "--seconds", "4200", *cache) == data
    assert json.loads(capsys.readouterr().out)["deadline"]["flags"] == decided["flags"]


def test_too_little_time_is_said(quick, tmp_path, capsys):
    bake(tmp_path, "short.gsgi", "--seconds", "1", "--cache", str(tmp_path / "cache"))
    told = capsys.readouterr()
    assert json.loads(told.out)["deadline"]["flags"].endswith("--error 0.2 --iterations 2")
    assert "1 s are too few: the cheapest bake takes about" in told.err
