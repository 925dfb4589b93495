"""samples/01_bake_a_box.py and samples/02_render_headless.py, one after the other, as a user runs them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from repository import ROOT, SAMPLES

from gsgi.runtime.file import codec
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import read_image

BAKE, RENDER = SAMPLES / "01_bake_a_box.py", SAMPLES / "02_render_headless.py"

# The sample with fewer places to look from, samples to fit, and paths in references: a quarter of the work.
QUICK = f"""
import runpy, sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from gsgi.baker.evaluation import held_out
from gsgi.baker.surface import budget
from small_tasks import place_quickly
place_quickly()
budget.SAMPLES_FEWEST, held_out.SIZE, held_out.SAMPLES = 1 << 14, 64, 256
sys.argv[0] = {str(BAKE)!r}
sys.path[0] = {str(SAMPLES)!r}
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def box(tmp_path_factory) -> Path:
    """The folder with the baked box, and report.txt: what the sample printed."""
    folder = tmp_path_factory.mktemp("box")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GSGI_CACHE", str(folder / "cache"))
        run = subprocess.run([sys.executable, "-c", QUICK, folder], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    (folder / "report.txt").write_text(run.stdout)
    return folder


def test_the_box_is_whole(box):
    scene = read_gltf(box / "box.glb")
    assert scene.warnings == ()
    assert [light.kind for light in scene.lights] == ["spot"]
    for mesh in scene.meshes:  # all walls face inwards
        assert ((np.array([0.5, 0.5, -0.5]) - mesh.position) * mesh.normal).sum(axis=1).min() > 0.4


def test_the_report_is_printed(box):
    lines = (box / "report.txt").read_text().splitlines()
    bake = codec.decode((box / "box.gsgi").read_bytes())
    count, size = len(bake.gaussians) + len(bake.coarse), (box / "box.gsgi").stat().st_size
    assert lines[0] == f"{count} Gaussians, {size} bytes, 2 bounces"
    assert any(line.split()[0] == "fit" for line in lines)
    assert float(lines[-1].split("SSIM ")[1]) > 0.98
    assert lines[-1].split()[:2] == ["final", "PSNR"]


def test_both_layers_are_drawn(box, gl, tmp_path):
    command = [sys.executable, RENDER, box / "box.glb", box / "box.gsgi", tmp_path]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.startswith("OpenGL: ")
    final, light = (read_image(tmp_path / f"{name}.exr") for name in ("final", "indirect"))
    assert final.shape == light.shape == (240, 320, 3)
    # The lamp shines down: of what lights the ceiling, all was baked; red bleeds onto the floor on the left.
    assert light[20, 160].min() > 0.01
    np.testing.assert_allclose(final[20, 160], 0.7 * light[20, 160], rtol=0.01)
    assert light[222, 70, 0] > 2 * light[222, 70, 2]
    for name in ("final", "indirect"):
        picture = np.asarray(Image.open(tmp_path / f"{name}.png"))
        assert picture.shape == (240, 320, 3)
        assert picture.max() > 100


@pytest.mark.parametrize("sample", [BAKE, RENDER])
def test_the_samples_are_short(sample):
    assert len(sample.read_text(encoding="utf-8").splitlines()) < 60
