"""samples/03_plug_in.py on a real scene: a host that knows nothing of our renderer."""

import subprocess
import sys

import numpy as np
from repository import SAMPLES

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import read_image

SCENE = SAMPLES / "scenes" / "cornell.glb"


def test_the_frame_is_what_the_file_says_times_albedo(gl, tmp_path):
    """One light of half a unit everywhere: half of each wall's colour, as a byte of albedo and halves hold it."""
    scene = read_gltf(SCENE)
    points = Triangles(scene).sample(3000, 0)
    light = np.full(points.position.shape, 0.5, np.float32)
    fine = from_surface(points.position, points.normal, light, 0)
    coarse = from_surface(points.position[:1], points.normal[:1], light[:1], 0)
    (tmp_path / "half.gsgi").write_bytes(codec.encode(Bake(fine, SurfaceBlend(), coarse=coarse)))
    lines = (SAMPLES / "03_plug_in.py").read_text().splitlines()
    assert len(lines) <= 60
    command = [sys.executable, SAMPLES / "03_plug_in.py", SCENE, tmp_path / "half.gsgi", tmp_path / "frame.exr"]
    subprocess.run(command, check=True)
    frame = read_image(tmp_path / "frame.exr")
    colours = np.array([m.base_color[:3] for m in scene.materials if not any(m.emission)])
    away = np.abs(frame[..., None, :] - 0.5 * colours).max(axis=-1).min(axis=-1)
    lit = frame.max(axis=-1) > 0.01
    assert lit.mean() > 0.6
    assert (away[lit] < 5e-3).mean() > 0.97  # the lamp has light of its own
    for colour in colours:
        assert (np.abs(frame - 0.5 * colour).max(axis=-1) < 5e-3).mean() > 0.02, colour
