"""Measurements that anyone can repeat: `./dev bench [NAME] [--json FILE]`. Benchmarks are not tests."""

import argparse
import json
import os
import platform
import subprocess
from pathlib import Path

from benches.c_library import c_library
from benches.cluster import cluster
from benches.copies import copies
from benches.deadline import deadline
from benches.decoders import decoders
from benches.error_time import error_time
from benches.fit import fit
from benches.flight import flight
from benches.foretold import foretold
from benches.format import format
from benches.frames import frames
from benches.front import front
from benches.host_state import host_state
from benches.leak import leak
from benches.light_groups import light_groups
from benches.looks import looks
from benches.lookup import lookup_bakes, lookup_lists, lookup_points
from benches.motion import motion
from benches.order import order
from benches.relief import relief
from benches.scenes import scenes
from benches.speed import speed
from benches.splats import splats
from benches.stages import stages
from benches.trace import trace
from benches.triangles import triangles
from benches.update import update
from benches.web import web
from benches.world import world
from benches.world_update import world_update
from repository import ROOT

from gsgi.runtime.atomic import check_writable, write_atomic

LOOKUP = lookup_lists, lookup_points
PASSES = splats, order, host_state, c_library, *LOOKUP
BENCHES = {
    bench.__name__: bench
    for bench in (
        fit,
        stages,
        deadline,
        speed,
        foretold,
        error_time,
        cluster,
        update,
        world_update,
        world,
        copies,
        flight,
        trace,
        scenes,
        *PASSES,
        triangles,
        leak,
        light_groups,
        relief,
        looks,
        lookup_bakes,
        format,
        decoders,
        front,
        web,
        frames,
        motion,
    )
}
BY_SCENE = speed.__name__, foretold.__name__, error_time.__name__
GROUPED = {"lookup": LOOKUP}
GROUPS = {name: [bench.__name__ for bench in group] for name, group in GROUPED.items()}


def machine() -> dict[str, str]:
    """What the measurements depend on: processor, cores, commit."""
    model = next(
        (line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line),
        platform.processor(),
    )
    git = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
    return {"processor": model, "cores": str(len(os.sched_getaffinity(0))), "commit": commit}


def table(rows: list[dict]) -> str:
    """Rows as aligned columns, in the order in which the keys first appear."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    cells = [columns] + [[str(row.get(column, "")) for column in columns] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(f"{cell:>{w}}" for cell, w in zip(line, widths, strict=True)) for line in cells)


def main() -> None:
    """Run the benchmarks that were asked for and print their tables."""
    epilog = "\n".join(f"  {name:<15} {bench.__doc__.splitlines()[0]}" for name, bench in BENCHES.items())
    epilog += "".join(f"\n  {name:<15} All of {', '.join(names)}." for name, names in GROUPS.items())
    parser = argparse.ArgumentParser(prog="./dev bench", description=__doc__, epilog="names:\n" + epilog,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("name", nargs="?", choices=[*BENCHES, *GROUPS], help="one benchmark (default: all)")
    parser.add_argument("--json", metavar="FILE", help="also write the rows to FILE")
    parser.add_argument("--scene", metavar="NAME", help=f"of {', '.join(BY_SCENE)}: one scene of the shared folder")
    options = parser.parse_args()
    if options.scene and options.name not in BY_SCENE:
        parser.error(f"--scene goes with {' or '.join(BY_SCENE)}")
    if options.json:
        check_writable(options.json)
    names = GROUPS.get(options.name, [options.name]) if options.name else list(BENCHES)
    arguments = {"scene": options.scene} if options.scene else {}
    results = {name: BENCHES[name](**arguments) for name in names}
    about = machine()
    print(" | ".join(f"{key} {value}" for key, value in about.items()))
    for name, rows in results.items():
        print(f"\n{name}\n{table(rows)}")
    if options.json:
        write_atomic(options.json, (json.dumps({"machine": about} | results, indent=2) + "\n").encode())


if __name__ == "__main__":
    main()
