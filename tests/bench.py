"""Measurements that anyone can repeat: `./dev bench [NAME] [--json FILE]`. Benchmarks are not tests."""

import argparse
import json
import os
import platform
import subprocess
from pathlib import Path

from gsgi.baker.bake import bake
from gsgi.baker.frame import draw
from gsgi.baker.held_out import judge
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.runtime import codec
from gsgi.runtime.atomic import check_writable, write_atomic
from gsgi.runtime.gltf import read_gltf

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "samples" / "scenes"


def stages() -> list[dict]:
    """Seconds and share of each stage of a bake with default settings and of one 512 x 512 frame."""
    rows = []
    for name in ("cornell", "cornell_emissive", "two_rooms"):
        progress = Progress()
        progress.say(f"bench: stages of {name}")
        with progress.stage("scene"):
            scene = read_gltf(SCENES / f"{name}.glb")
        data = bake(scene, Settings(), progress)
        baked = codec.decode(data)
        with progress.stage("render"):
            draw(scene, baked, next(iter(scene.cameras.values())), 512, 512, "auto")
        held_out = judge(scene, baked, Settings().seed, progress)
        total = sum(progress.seconds.values())
        for stage, seconds in progress.seconds.items():
            share = seconds / total
            rows.append({"scene": name, "stage": stage, "seconds": round(seconds, 2), "share": round(share, 3)})
        count, size = len(baked.gaussians), len(data)
        worst = min(view.ssim for view in held_out)
        rows.append({"scene": name, "stage": "all", "seconds": round(total, 2), "share": 1.0,
                     "gaussians": count, "bytes": size, "ssim": round(worst, 4)})  # fmt: skip
    return rows


BENCHES = {"stages": stages}


def machine() -> dict[str, str]:
    """What the figures depend on: processor, cores, commit."""
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
    epilog = "\n".join(f"  {name:<8} {bench.__doc__.splitlines()[0]}" for name, bench in BENCHES.items())
    parser = argparse.ArgumentParser(prog="./dev bench", description=__doc__, epilog="names:\n" + epilog,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("name", nargs="?", choices=[*BENCHES], help="one benchmark (default: all)")
    parser.add_argument("--json", metavar="FILE", help="also write the rows to FILE")
    options = parser.parse_args()
    if options.json:
        check_writable(options.json)
    names = [options.name] if options.name else list(BENCHES)
    results = {name: BENCHES[name]() for name in names}
    about = machine()
    print(" | ".join(f"{key} {value}" for key, value in about.items()))
    for name, rows in results.items():
        print(f"\n{name}\n{table(rows)}")
    if options.json:
        write_atomic(options.json, (json.dumps({"machine": about} | results, indent=2) + "\n").encode())


if __name__ == "__main__":
    main()
