"""`gsgi bake --ray`: the bytes of one machine, whatever dies on the way. The nodes are processes of this machine."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from repository import ROOT
from small_tasks import FAULTS, SURFACE, WORLD, SmallNode, baked, baked_world, make_small, run

from gsgi.baker.cluster import engine
from gsgi.baker.cluster.node import Member
from gsgi.baker.tasks import request
from gsgi.runtime.file import codec

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
pytest.importorskip("ray.cluster_utils", reason="no Ray: pip install 'gsgi[cluster]'")

from ray.cluster_utils import Cluster

STORE = 100 << 20  # bytes, the least that Ray likes
DRIVER = f"""
import sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from gsgi.baker.cli import main
from gsgi.baker.cluster import engine
from small_tasks import SmallNode, make_small
make_small()
engine.Node = SmallNode
main.main()
"""


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    """The folder of what is to go wrong."""
    folder = tmp_path_factory.mktemp("faults")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FAULTS, str(folder))  # nodes inherit both
        patch.setenv("PYTHONPATH", str(ROOT / "tests"))
        yield folder


@pytest.fixture(scope="module")
def cluster(faults):
    """A head without cores, and two nodes with one each."""
    made = Cluster(True, head_node_args={"num_cpus": 0, "object_store_memory": STORE, "include_dashboard": False})
    for _ in range(2):
        made.add_node(num_cpus=1, object_store_memory=STORE)
    yield made
    made.shutdown()


@pytest.fixture(autouse=True)
def small(monkeypatch):
    make_small(monkeypatch.setattr)
    monkeypatch.setattr(engine, "Node", SmallNode)


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> tuple[bytes, set[str]]:
    """What a bake on one machine gives."""
    with pytest.MonkeyPatch.context() as patch:
        make_small(patch.setattr)
        return baked(SURFACE, tmp_path_factory.mktemp("plain") / "cache")


def marks(cache: Path) -> int:
    """How many tasks are finished."""
    return len(list(cache.glob("task-*")))


def wait_for(cache: Path, count: int, going: Callable[[], bool]) -> None:
    """Wait until so many tasks are finished, while the bake is `going` on."""
    while marks(cache) < count:
        assert going()
        time.sleep(0.02)


def test_a_driver_a_worker_and_a_node_die(cluster, faults, plain, tmp_path, capsys):
    cache = tmp_path / "cache"
    command = [sys.executable, "-c", DRIVER, "bake", *SURFACE, "-o", str(tmp_path / "x.gsgi"), "--cache", str(cache)]
    driver = subprocess.Popen([*command, "--ray", cluster.address, "--quiet"])
    wait_for(cache, 3, lambda: driver.poll() is None)
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    found = marks(cache)
    assert 3 <= found < 10

    (faults / "die-surface-0").touch()
    lost = cluster.add_node(num_cpus=1, object_store_memory=STORE)
    done = threading.Event()
    removing = threading.Thread(
        target=lambda: (wait_for(cache, found + 4, lambda: not done.is_set()), cluster.remove_node(lost, False))
    )
    removing.start()
    try:
        assert baked(SURFACE, cache, "--ray", cluster.address) == plain
    finally:
        done.set()
        removing.join()
    said = capsys.readouterr().err
    assert "the task surface-0 failed and is tried again: The actor died unexpectedly" in said
    assert not (faults / "die-surface-0").exists()
    assert marks(cache) > found


def test_a_task_that_fails_again_and_again_is_named_and_the_rest_is_kept(cluster, faults, plain, tmp_path, capsys):
    cache = tmp_path / "cache"
    fails = faults / "fail-coarse"
    fails.touch()
    arguments = [*SURFACE, "-o", str(tmp_path / "x.gsgi"), "--cache", str(cache), "--ray", cluster.address]
    run("bake", *arguments, code=4)
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "gsgi: the task coarse failed 3 times, at last on " in line] == said[-1:]
    assert said[-1].endswith(": no light in here")
    assert not (tmp_path / "x.gsgi").exists()
    assert marks(cache) >= 7
    fails.unlink()
    assert baked(SURFACE, cache) == plain  # on this machine alone


def test_light_groups_are_baked_apart_there_too(cluster, tmp_path):
    grouped = [*SURFACE, "--group", "sky=environment"]
    there = baked(grouped, tmp_path / "there", "--ray", cluster.address)
    assert there == baked(grouped, tmp_path / "here")
    assert [group.name for group in codec.decode(there[0]).groups] == ["base", "sky"]


def test_nodes_take_the_sectors_of_a_world_and_one_dies(cluster, faults, tmp_path, capsys):
    (faults / "die-sector-1").touch()
    there = baked_world(WORLD, tmp_path / "there", tmp_path / "cache there", "--ray", cluster.address)
    assert "the task sector-1 failed and is tried again: The actor died unexpectedly" in capsys.readouterr().err
    assert there == baked_world(WORLD, tmp_path / "here", tmp_path / "cache here")
    left, alone = ({path.name for path in (tmp_path / f"cache {where}").iterdir()} for where in ("there", "here"))
    assert {name for name in left if not name.startswith("task-")} == alone  # so that an update finds all that it needs


def test_nodes_of_another_version_take_no_tasks(cluster, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(engine, "member", lambda: Member("other", "avx2", 1))
    arguments = [*SURFACE, "-o", str(tmp_path / "x.gsgi"), "--cache", str(tmp_path / "cache")]
    run("bake", *arguments, "--ray", cluster.address, code=4)
    lines = capsys.readouterr().err.splitlines()
    reason = "takes no tasks: it has another version of gsgi, or of a package that gsgi calls, than this machine"
    assert sum(line.startswith("warning: ") and line.endswith(reason) for line in lines) >= 1
    assert lines[-1].startswith("gsgi: no node takes tasks: ")
    assert lines[-1].endswith(reason)


def test_where_there_is_no_cluster(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    arguments = [*SURFACE, "-o", str(tmp_path / "x.gsgi"), "--cache", str(tmp_path / "cache")]
    with socket.create_server(("127.0.0.1", 0)) as server:
        closed = f"127.0.0.1:{server.getsockname()[1]}"
    for address, reason in ((closed, "refused"), ("here", "expected auto or HOST:PORT, got 'here'")):
        run("bake", *arguments, "--ray", address, code=4)
        said = capsys.readouterr().err
        assert said.startswith(f"gsgi: --ray {address}: cannot join a cluster: ")
        assert reason in said
        assert said.count("\n") == 1


def test_a_version_is_that_of_the_code_and_its_packages():
    assert request.code() == SmallNode.join(None).code
    assert SmallNode.join(None).instructions in ("scalar", "avx2", "avx512")
