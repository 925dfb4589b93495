"""A box made in Python: written as glTF, baked by the command line, and what the report says of the bake.

python samples/01_bake_a_box.py build/box    # leaves box.glb and box.gsgi there
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from glb_writer import Glb  # a small writer of .glb files that stands beside this sample

WALLS = {  # what a wall of the box reflects, and its corners: 1 m wide, open towards the camera
    "white floor": ((0.7, 0.7, 0.7), [(0, 0, 0), (1, 0, 0), (1, 0, -1), (0, 0, -1)]),
    "white ceiling": ((0.7, 0.7, 0.7), [(0, 1, -1), (1, 1, -1), (1, 1, 0), (0, 1, 0)]),
    "white back": ((0.7, 0.7, 0.7), [(0, 0, -1), (1, 0, -1), (1, 1, -1), (0, 1, -1)]),
    "red left": ((0.6, 0.06, 0.05), [(0, 0, 0), (0, 0, -1), (0, 1, -1), (0, 1, 0)]),
    "green right": ((0.1, 0.45, 0.1), [(1, 0, -1), (1, 0, 0), (1, 1, 0), (1, 1, -1)]),
}
DRAFT = ["--quality", "draft", "--budget", "200", "--samples", "64", "--bounces", "2", "--views", "8"]


def write_box(file: Path) -> None:
    """Five walls, a spot under the ceiling that shines down, and a camera outside the open side."""
    box = Glb()
    for name, (color, corners) in WALLS.items():
        box.solid(name, [np.array(corners)], box.material(name, color))
    down = (-0.7071068, 0, 0, 0.7071068)  # a quarter turn about x: -Z to -Y
    box.light("lamp", (0.5, 0.98, -0.5), down, type="spot", color=[1, 0.9, 0.8], intensity=2, spot={})
    box.camera("front", (0.5, 0.5, 1.4), (0.5, 0.5, 0), 0.75)
    file.write_bytes(box.encode())


def main(folder: str = "build/box") -> None:
    """Write, bake, report."""
    scene = Path(folder, "box.glb")
    scene.parent.mkdir(parents=True, exist_ok=True)
    write_box(scene)

    bake = [sys.executable, "-m", "gsgi.baker", "bake", scene, "-o", scene.with_suffix(".gsgi"), *DRAFT, "--json"]
    report = json.loads(subprocess.run(bake, stdout=subprocess.PIPE, check=True).stdout)  # progress goes to stderr

    print(f"{report['gaussians']} Gaussians, {report['bytes']} bytes, {report['bounces']} bounces")
    for stage in report["stages"]:
        print(f"  {stage['stage']:<12}{stage['seconds']:>7.2f} s")
    print("in views that were not fitted:")
    for layer in ("indirect", "final"):
        reached = report["held_out"]["mean"][layer]
        print(f"  {layer:<12}PSNR {reached['psnr']:.1f} dB, SSIM {reached['ssim']:.4f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
