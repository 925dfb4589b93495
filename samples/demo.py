"""The whole pipeline in one run: scene -> bake -> file -> frame, compared with path tracing. Run by `./dev demo`.

Writes cornell.gsgi, report.json and panels.png to build/demo/.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsgi.baker.bake import bake
from gsgi.baker.cache.store import Cache
from gsgi.baker.cli.console import Console
from gsgi.baker.evaluation.comparison import Comparison, compare_frame
from gsgi.baker.evaluation.pictures import panels
from gsgi.baker.plan import make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.trace import reference
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.atomic import write_atomic
from gsgi.runtime.display import auto_exposure, tone_map
from gsgi.runtime.file.reader import read_bake
from gsgi.runtime.gl.headless import draw
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import write_image

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "samples" / "scenes" / "cornell.glb"
OUT = ROOT / "build" / "demo"
CAMERA = "front"  # hidden from the bake, which would fit it
SIZE = 256  # px
SAMPLES = 1024  # per pixel of the reference, in two halves


def main() -> None:
    """Run every stage and print one table."""
    OUT.mkdir(parents=True, exist_ok=True)
    progress = Progress(Console())
    with progress.stage("scene"):
        scene = read_gltf(SCENE)
    plan = make_plan(replace(scene, cameras={}), Settings(), progress, Cache())
    write_atomic(OUT / "cornell.gsgi", bake(plan, progress).data)
    baked = read_bake(OUT / "cornell.gsgi")

    camera = scene.cameras[CAMERA]
    with progress.stage("render"):
        layers = draw(scene, baked, camera, SIZE, SIZE, "auto")
    with progress.stage("reference", 2 * SIZE**2, "points") as advance:
        truth = reference.trace(Tracer(scene), camera, SIZE, SIZE, SAMPLES, seed=7, advance=advance)
        comparison = compare_frame(layers["final"], truth)

    exposure = auto_exposure(truth.final)
    lit = {
        "primary only": layers["primary"],
        "indirect only (albedo * B)": layers["albedo"] * layers["indirect"],
        "final": layers["final"],
        f"path traced, {SAMPLES} samples": truth.final,
    }
    pictures = {name: tone_map(image.astype(np.float32), exposure) for name, image in lit.items()}
    write_image(OUT / "panels.png", panels(pictures))
    report(len(baked.gaussians) + len(baked.coarse or ()), comparison, progress)


def report(gaussians: int, comparison: Comparison, progress: Progress) -> None:
    """Print the table and write the same figures to report.json."""
    rows = [{"stage": name, "seconds": round(seconds, 2)} for name, seconds in progress.seconds.items()]
    figures = {
        "gaussians": gaussians,
        "bytes": (OUT / "cornell.gsgi").stat().st_size,
        "ssim": round(comparison.ssim, 4),
        "ssim_ceiling": round(comparison.ssim_ceiling, 4),
        "psnr": round(comparison.psnr, 2),
        "flip": round(comparison.flip, 4),
    }
    write_atomic(OUT / "report.json", (json.dumps({"stages": rows} | figures, indent=2) + "\n").encode())
    print(f"\n{'stage':<12} {'seconds':>8}")
    for row in rows:
        print(f"{row['stage']:<12} {row['seconds']:>8.2f}")
    print(f"{'all':<12} {sum(row['seconds'] for row in rows):>8.2f}\n")
    for name, value in figures.items():
        print(f"{name.replace('_', ' '):<12} {value:>8}")
    print(f"\nfinal image against path tracing, camera {CAMERA!r}; pictures: {(OUT / 'panels.png').relative_to(ROOT)}")


if __name__ == "__main__":
    main()
