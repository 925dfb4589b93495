"""A bake as tasks: processes that run them in any order that works leave what the bake looks for."""

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_flags import flags
from repository import ROOT
from small_tasks import SURFACE, WORLD, baked, baked_world, make_small, run, see_little

from gsgi.baker import estimate
from gsgi.baker.cache.store import Cache
from gsgi.baker.surface import chunks
from gsgi.baker.tasks.task import Task, ignore, needed, waves
from gsgi.baker.trace.cached_tracer import CachedTracer

OVER, GROUPS = [*SURFACE, "--operator", "over"], [*SURFACE, "--group", "sky=environment"]

# A process of a farm: runs a task for each line that it reads and answers with the exit code. With a number, it dies
# when it is about to keep its so many-th layer of samples.
PROCESS = f"""
import os, signal, sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from gsgi.baker.cache.store import Cache
from gsgi.baker.cli import main
from small_tasks import make_small
make_small()
layers, put = int(sys.argv[1]), Cache.put
def putting(cache, key, arrays):
    global layers
    layers -= key.startswith("layer")
    if layers == 0 and key.startswith("layer"):
        os.kill(os.getpid(), signal.SIGKILL)
    put(cache, key, arrays)
Cache.put = putting
for line in sys.stdin:
    print(main.run(["task", line.strip(), *sys.argv[2:]]), flush=True)
"""


class Process:
    """One process of a farm, which outlives its tasks so that a test need not wait for imports."""

    def __init__(self, *arguments: str, dies_at: int = 0):
        command = [sys.executable, "-c", PROCESS, str(dies_at), *arguments]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self, key: str) -> int | None:
        """Run a task; its exit code, None if the process died."""
        self.process.stdin.write(f"{key}\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        return int(answer) if answer else None

    def end(self) -> None:
        """Let the process end."""
        self.process.stdin.close()
        self.process.wait(timeout=60)
        self.process.stdout.close()


@pytest.fixture(scope="module")
def placed(tmp_path_factory) -> Path:
    """A cache that has the plan, which takes the longest."""
    folder = tmp_path_factory.mktemp("placed")
    with pytest.MonkeyPatch.context() as patch:
        make_quick(patch)
        run("tasks", *SURFACE, "--cache", str(folder))
    return folder


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    make_quick(monkeypatch)


def make_quick(patch: pytest.MonkeyPatch) -> None:
    """Small tasks, and no waiting for estimates."""
    make_small(patch.setattr)
    rates = estimate.Rates(None, 2e-6, 1e-6, 0.0, (), 0.0, 0.0, 0.0)
    patch.setattr(estimate.Rates, "timed", staticmethod(lambda plan: rates))
    patch.setattr(estimate.Rates, "fits", lambda self, plan: [3.0, 2.0])
    patch.setattr(estimate.Rates, "solved", lambda self, plan: 1.0)


def tasks(capsys, *arguments: str) -> list[dict]:
    capsys.readouterr()
    run("tasks", *arguments)
    return json.loads(capsys.readouterr().out)


def in_some_order(listed: list[dict], rng: random.Random) -> list[dict]:
    """The tasks in an order that works and is none of the list's making."""
    done, left, order = set(), list(listed), []
    while left:
        task = rng.choice([task for task in left if done.issuperset(task["needs"])])
        left.remove(task)
        done.add(task["key"])
        order.append(task)
    return order


@pytest.fixture
def caches(placed, tmp_path) -> tuple[Path, Path]:
    """Two caches with the plan alone: of a plain bake, and of a farm."""
    for name in ("plain", "farm"):
        (tmp_path / name).mkdir()
        for path in (*placed.glob("placement-*"), *placed.glob("points-*")):
            shutil.copy(path, tmp_path / name)
    return tmp_path / "plain", tmp_path / "farm"


def forbid_work(monkeypatch) -> None:
    """Let a bake fail that traces or fits anything."""

    def no_work(*_):
        raise AssertionError("nothing is left to do")

    monkeypatch.setattr(CachedTracer, "tracer", property(no_work))
    monkeypatch.setattr("gsgi.baker.surface.fit.fit_surface", no_work)
    monkeypatch.setattr("gsgi.baker.surface.coarse.coarse_level", no_work)
    monkeypatch.setattr("gsgi.baker.surface.group_light.group_light", no_work)
    monkeypatch.setattr("gsgi.baker.over.fit.fit", no_work)


def test_processes_share_the_tasks_of_a_bake_and_one_is_killed(caches, monkeypatch, capsys):
    arguments = [*GROUPS, "--cache", str(caches[1])]
    doomed, other = Process(*arguments, "--quiet", dies_at=3), Process(*arguments, "--quiet")
    plain = baked(GROUPS, caches[0])
    rng = random.Random(5)
    processes, killed = [doomed, other], []
    for task in in_some_order(tasks(capsys, *arguments), rng):
        process = rng.choice(processes)
        code = process.run(task["key"])
        if code is None:
            killed.append(task["key"])
            processes.remove(doomed)
            code = other.run(task["key"])
        assert code == 0, task
    doomed.end()
    other.end()
    assert len(killed) == 1
    forbid_work(monkeypatch)
    assert baked(GROUPS, caches[1]) == plain


def test_a_bake_with_over_finds_all_that_its_tasks_left(caches, monkeypatch, capsys):
    plain = baked(OVER, caches[0])
    arguments = [*OVER, "--cache", str(caches[1])]
    for task in in_some_order(tasks(capsys, *arguments), random.Random(6)):
        run("task", task["key"], *arguments)
    forbid_work(monkeypatch)
    assert baked(OVER, caches[1]) == plain


def test_a_world_has_a_task_for_each_sector(tmp_path, monkeypatch, capsys):
    see_little(monkeypatch.setattr)
    plain, farm = (tmp_path / name for name in ("plain", "farm"))
    files = baked_world(WORLD, plain, tmp_path / "cache")
    arguments = [*WORLD, "--cache", str(farm)]
    monkeypatch.setattr(estimate, "estimate", lambda plan: {"fit": 2.0, "irradiance": 3.0})
    listed = tasks(capsys, *arguments)
    assert [(task["key"], task["wave"]) for task in listed] == [("plan", 0), ("sector-0", 1), ("sector-1", 1)]
    assert listed[1]["seconds"] == listed[2]["seconds"] > 5  # the fit and the tracing, and the views
    run("task", "sector-1", *arguments)
    assert "sector-2: expected one of the 3 keys" in refused(capsys, 1, "task", "sector-2", *arguments)
    assert "sector-0: needs the task plan first" in refused(capsys, 4, "task", "sector-0", *arguments, "--seed", "1")
    free = [word for word in arguments if word not in flags(budget=8)]
    assert "--target-bytes: cannot be had with --sectors" in refused(
        capsys, 1, "tasks", *free, "--target-bytes", "9000"
    )
    run("task", "sector-0", *arguments)
    forbid_work(monkeypatch)
    assert baked_world(WORLD, tmp_path / "again", farm) == files


def refused(capsys, code: int, *arguments: str) -> str:
    """The one line on stderr of a command that ends with this exit code."""
    capsys.readouterr()
    run(*arguments, code=code)
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    return said


def test_what_is_missing_is_named(placed, tmp_path, capsys):
    arguments = [*SURFACE, "--cache", str(placed)]
    assert "fit: needs the task known1-0 first, which is not finished in" in refused(
        capsys, 4, "task", "fit", *arguments
    )
    assert "known1: needs the task known1-0 first" in refused(capsys, 4, "task", "known1", *arguments)
    elsewhere = [*SURFACE, "--cache", str(tmp_path / "empty")]
    assert "known1-0: needs the task plan first" in refused(capsys, 4, "task", "known1-0", *elsewhere)
    other_flags = [*SURFACE, "--seed", "1", "--cache", str(placed)]
    assert "known1-0: needs the task plan first" in refused(capsys, 4, "task", "known1-0", *other_flags)
    assert "fit-7: expected one of the" in refused(capsys, 1, "task", "fit-7", *arguments)
    for flag in ("--target-loss", "--seconds"):
        free = [word for word in arguments if word not in flags(budget=8, error=0, iterations=16)]
        for command in (["tasks"], ["task", "fit"]):
            assert f"{flag}: decides while the bake runs" in refused(capsys, 1, *command, *free, flag, "9")


def test_a_finished_task_ends_at_once_and_one_whose_results_are_gone_runs_again(placed, capsys, monkeypatch):
    arguments = [*SURFACE, "--cache", str(placed)]
    run("task", "known1-0", *arguments)
    left = {path for path in placed.iterdir() if path.name.startswith("layer-")}
    assert len(left) == 1
    with monkeypatch.context() as patch:
        patch.setattr("gsgi.baker.tasks.request.make_plan", lambda *_: pytest.fail("planned again"))
        capsys.readouterr()
        run("task", "known1-0", *arguments)
        assert capsys.readouterr().err == "finished known1-0 before\n"
    for path in left:
        path.unlink()
    assert "known1: needs the task known1-0 first" in refused(capsys, 4, "task", "known1", *arguments)
    run("task", "known1-0", *arguments)
    assert {path for path in placed.iterdir() if path.name.startswith("layer-")} == left


def test_a_cache_that_keeps_nothing_is_an_error(placed, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Cache, "put", lambda *_: None)
    arguments = [*SURFACE, "--cache", str(placed), "--bounces", "1"]
    assert f"{placed}: cannot keep the results of the task plan" in refused(capsys, 2, "task", "plan", *arguments)


def test_the_list_says_what_comes_first_and_what_it_costs(placed, capsys):
    listed = tasks(capsys, *SURFACE, "--cache", str(placed))
    again = tasks(capsys, *SURFACE, "--cache", str(placed))
    assert [dict(task, seconds=0) for task in listed] == [dict(task, seconds=0) for task in again]
    by_key = {task["key"]: task for task in listed}
    assert len(by_key) == len(listed)
    for number, task in enumerate(listed):
        before = {other["key"]: other["wave"] for other in listed[:number]}
        assert set(task["needs"]) <= set(before)
        assert task["wave"] == 1 + max((before[need] for need in task["needs"]), default=-1)
    assert by_key["known1-0"]["seconds"] == pytest.approx(2e-6 * 64 * chunks.CHUNK, abs=0.01)  # whole paths
    assert (by_key["fit"]["seconds"], by_key["coarse"]["seconds"]) == (3.0, 2.0)
    unchecked = tasks(capsys, *SURFACE, "--no-evaluate", "--cache", str(placed))
    assert {task["stage"] for task in listed} - {task["stage"] for task in unchecked} == {"references"}


def test_needs_reach_through_other_tasks():
    chain = [Task(key, "", needs, ignore) for key, needs in (("a", ()), ("b", ("a",)), ("x", ("a",)), ("c", ("b",)))]
    assert [task.key for task in needed(chain, "c")] == ["a", "b"]
    assert waves(chain) == {"a": 0, "b": 1, "x": 1, "c": 2}
