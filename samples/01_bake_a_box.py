"""Make a box in Python, write it as glTF, bake it, and print figures from the report.

python samples/01_bake_a_box.py [FOLDER]    # leaves box.glb and box.gsgi there; default: build/samples
"""

import sys
from pathlib import Path

import numpy as np
from draft import OUT
from glb_writer import Glb  # a small writer of .glb files beside this sample

import gsgi

WALLS = {  # reflectance and corners of each wall; the box is 1 m wide and open towards the camera
    "white floor": ((0.7, 0.7, 0.7), [(0, 0, 0), (1, 0, 0), (1, 0, -1), (0, 0, -1)]),
    "white ceiling": ((0.7, 0.7, 0.7), [(0, 1, -1), (1, 1, -1), (1, 1, 0), (0, 1, 0)]),
    "white back": ((0.7, 0.7, 0.7), [(0, 0, -1), (1, 0, -1), (1, 1, -1), (0, 1, -1)]),
    "red left": ((0.6, 0.06, 0.05), [(0, 0, 0), (0, 0, -1), (0, 1, -1), (0, 1, 0)]),
    "green right": ((0.1, 0.45, 0.1), [(1, 0, -1), (1, 0, 0), (1, 1, 0), (1, 1, -1)]),
}


def write_box(file: Path) -> None:
    """Write five walls, a spot light under the ceiling that shines down, and a camera outside the open side."""
    box = Glb()
    for name, (color, corners) in WALLS.items():
        box.solid(name, [np.array(corners)], box.material(name, color))
    down = (-0.7071068, 0, 0, 0.7071068)  # a quarter turn about x: -Z to -Y
    box.light("lamp", (0.5, 0.98, -0.5), down, type="spot", color=[1, 0.9, 0.8], intensity=2, spot={})
    box.camera("front", (0.5, 0.5, 1.4), (0.5, 0.5, 0), 0.75)
    file.write_bytes(box.encode())


def main(folder: str | Path = OUT) -> None:
    """Write, bake, report."""
    scene = Path(folder, "box.glb")
    scene.parent.mkdir(parents=True, exist_ok=True)
    write_box(scene)

    settings = gsgi.Settings(quality="draft", budget=200, samples=64, bounces=2, views=8)
    report = gsgi.bake(scene, scene.with_suffix(".gsgi"), settings=settings)

    print(f"{report.gaussians} Gaussians, {len(report.data)} bytes, {report.plan.settings.bounces} bounces")
    for stage, seconds in report.seconds.items():
        print(f"  {stage:<12}{seconds:>7.2f} s")
    print("in held-out views:")
    for layer in ("indirect", "final"):
        reached = getattr(report.evaluation.mean, layer)
        print(f"  {layer:<12}PSNR {reached.psnr:.1f} dB, SSIM {reached.ssim:.4f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
