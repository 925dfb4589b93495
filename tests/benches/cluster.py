"""What a bake on a Ray cluster takes, beside the same bake on one of its cores."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from repository import SCENES

FLAGS = ["--quality", "draft", "--no-evaluate"]
BEFORE = "scene", "views", "plan"  # stages that each bake finds in the cache
STORE = 200 << 20  # bytes of each node's object store


def cluster() -> list[dict]:
    """Seconds of a bake without its plan on one core, and on 1 and 2 nodes of a core each; bytes moved."""
    cores = sorted(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder:
        scene = [str(SCENES / "cornell.glb"), *FLAGS]
        subprocess.run([sys.executable, "-m", "gsgi.baker", "plan", *scene[:3], "--cache", f"{folder}/plan"],
                       check=True, stdout=subprocess.DEVNULL)  # fmt: skip
        with _on(cores[:1]):
            alone, _, data = _bake(scene, Path(folder), "alone")
        rows = [{"nodes": "none", "seconds": round(alone, 1)}]
        for count in (1, 2)[: len(cores)]:
            with _nodes(cores[:count]) as address:
                seconds, log, there = _bake(scene, Path(folder), f"nodes{count}", "--ray", address)
            assert there == data, "another file"
            tasks, sent, received = re.search(r"(\d+) tasks on .* ([\d.]+) MB sent, ([\d.]+) MB received", log).groups()
            row = {"nodes": count, "seconds": round(seconds, 1), "tasks": int(tasks), "sent_mb": float(sent),
                   "received_mb": float(received), "faster": round(alone / seconds, 2)}  # fmt: skip
            if count == 1:
                row["overhead_s_per_task"] = round((seconds - alone) / int(tasks), 2)
            rows.append(row)
        return rows


def _bake(scene: list[str], folder: Path, name: str, *more: str) -> tuple[float, str, bytes]:
    """Seconds after the plan, log, and bytes of a bake with a cache of its own that has the plan."""
    shutil.copytree(folder / "plan", folder / name)
    output = folder / f"{name}.gsgi"
    command = [sys.executable, "-m", "gsgi.baker", "bake", *scene, "-o", str(output), "--cache", str(folder / name)]
    run = subprocess.run([*command, "--json", *more], check=True, capture_output=True, text=True)
    stages = json.loads(run.stdout)["stages"]
    seconds = sum(stage["seconds"] for stage in stages if stage["stage"] not in BEFORE)
    return seconds, run.stderr, output.read_bytes()


@contextmanager
def _on(cores: list[int]) -> Iterator[None]:
    """Keep processes that start in the block on some cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def _nodes(cores: list[int]) -> Iterator[str]:
    """The address of a cluster with a node on each core, beside a head that takes no tasks."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    from ray.cluster_utils import Cluster

    made = Cluster(True, head_node_args={"num_cpus": 0, "object_store_memory": STORE, "include_dashboard": False})
    try:
        for core in cores:
            with _on([core]):
                made.add_node(num_cpus=1, object_store_memory=STORE)
        yield made.address
    finally:
        made.shutdown()
