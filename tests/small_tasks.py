"""A bake whose tasks take tenths of a second, in this process and in others."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

from command_flags import flags
from repository import SCENES

from gsgi.baker.cli import main
from gsgi.baker.cluster.node import Node
from gsgi.baker.evaluation import bias, held_out
from gsgi.baker.surface import budget, chunks
from gsgi.baker.views import importance, placement, viewpoints

TINY = flags(budget=8, views=2, view_size=24, samples=128, error=0, iterations=16)
SURFACE = [str(SCENES / "furnace.glb"), *TINY, "--env", "0.05,0.1,0.2"]
WORLD = [str(SCENES / "corridor.glb"), *TINY, "--sectors", "10.5"]  # two of them
FAULTS = "GSGI_TEST_FAULTS"  # variable: folder of files that name what is to go wrong on nodes


def place_quickly(put: Callable[[object, str, object], object] = setattr) -> None:
    """A placement that looks at less and from fewer places, by `put(module, name, value)`: a quarter of the work."""
    for module, name, value in (
        (placement, "SAMPLES", (512, 1024)), (placement, "VALIDATION_SAMPLES", 512), (importance, "EYES", 96),
        (viewpoints, "VIEWPOINTS", 128), (viewpoints, "MORE_VIEWPOINTS", 32),
    ):  # fmt: skip
        put(module, name, value)


def sample_little(put: Callable[[object, str, object], object] = setattr) -> None:
    """Few samples, few points of known light, and small chunks of both, by `put(module, name, value)`."""
    for module, name, value in (
        (budget, "SAMPLES_FEWEST", 1 << 12), (budget, "KNOWN_MOST", 1 << 12), (chunks, "CHUNK", 1 << 11),
    ):  # fmt: skip
        put(module, name, value)


def make_small(put: Callable[[object, str, object], object] = setattr) -> None:
    """Few samples and small views, by `put(module, name, value)`."""
    place_quickly(put)
    for module, name, value in (
        (placement, "HELD_OUT", 1), (held_out, "SIZE", 16), (held_out, "SAMPLES", 32), (held_out, "GATHERED", 32),
        (bias, "SAMPLES", 32), (budget, "SAMPLES_FEWEST", 1 << 10), (budget, "FREE_PER_GAUSSIAN", 64),
        (budget, "KNOWN_MOST", 1 << 10), (chunks, "CHUNK", 1 << 9),
    ):  # fmt: skip
        put(module, name, value)


def see_little(put: Callable[[object, str, object], object] = setattr) -> None:
    """Few places from which views are chosen, by `put(module, name, value)`."""
    for module, name, value in (
        (placement, "SAMPLES", (512,)), (placement, "VALIDATION_SAMPLES", 512), (placement, "POINTS", 2048),
        (viewpoints, "VIEWPOINTS", 48), (viewpoints, "MORE_VIEWPOINTS", 8), (importance, "EYES", 48),
    ):  # fmt: skip
        put(module, name, value)


def run(command: str, *arguments: str, code: int = 0) -> None:
    """Run a command in this process; check its exit code."""
    assert main.run([command, *arguments, "--quiet"]) == code


def baked_world(arguments: list[str], folder: Path, cache: Path, *more: str) -> dict[str, bytes]:
    """The files of a bake in sectors, the manifest among them, by name."""
    folder.mkdir(exist_ok=True)
    run("bake", *arguments, "-o", str(folder / "level.gsgi.json"), "--cache", str(cache), *more)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def baked(arguments: list[str], cache: Path, *more: str) -> tuple[bytes, set[str]]:
    """The bytes of a bake, and the names of what is in its cache then, without marks of tasks."""
    output = cache.with_suffix(".gsgi")
    run("bake", *arguments, "-o", str(output), "--cache", str(cache), *more)
    return output.read_bytes(), {path.name for path in cache.iterdir() if not path.name.startswith("task-")}


class SmallNode(Node):
    """A node of a cluster that makes small tasks, and on which some die (file `die-KEY`, once) or fail (`fail-KEY`)."""

    def __init__(self):
        make_small()
        super().__init__()

    def run(self, key: str, names: list[str], *entries: bytes) -> dict[str, bytes]:
        """Run a task, or do what goes wrong."""
        dies, fails = (Path(os.environ[FAULTS], f"{what}-{key}") for what in ("die", "fail"))
        if dies.exists():
            dies.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        if fails.exists():
            raise RuntimeError("no light in here\nand none there")
        return super().run(key, names, *entries)
