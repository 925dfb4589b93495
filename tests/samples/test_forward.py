"""samples/09_forward.py on a real scene: a forward renderer that knows nothing of ours."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
from repository import SAMPLES

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import read_image

SAMPLE, SCENE = SAMPLES / "09_forward.py", SAMPLES / "scenes" / "cornell.glb"
LIGHT = 0.5


def test_surfaces_and_glass_show_the_light_of_the_file(gl, tmp_path):
    """One light everywhere: that times each wall's colour, and a white half of it before half of what is behind."""
    scene = read_gltf(SCENE)
    points = Triangles(scene).sample(3000, 0)
    light = np.full(points.position.shape, LIGHT, np.float32)
    fine = from_surface(points.position, points.normal, light, 0)
    coarse = from_surface(points.position[:1], points.normal[:1], light[:1], 0)
    everywhere = replace(coarse, scale=np.full((1, 3), 10, np.float32))
    (tmp_path / "half.gsgi").write_bytes(codec.encode(Bake(fine, SurfaceBlend(), coarse=everywhere)))
    assert len(SAMPLE.read_text().splitlines()) <= 60
    subprocess.run([sys.executable, SAMPLE, SCENE, tmp_path / "half.gsgi", tmp_path / "frame.exr"], check=True)
    frame = read_image(tmp_path / "frame.exr")
    colours = np.array([m.base_color[:3] for m in scene.materials if not any(m.emission)])
    bare, behind_glass = LIGHT * colours, LIGHT * (0.5 + 0.5 * colours)
    away = np.abs(frame[..., None, :] - np.concatenate([bare, behind_glass])).max(axis=-1).min(axis=-1)
    lit = frame.max(axis=-1) > 0.01
    assert lit.mean() > 0.6
    assert (away[lit] < 5e-3).mean() > 0.97  # the lamp has light of its own
    for colour in bare:
        assert (np.abs(frame - colour).max(axis=-1) < 5e-3).mean() > 0.02, colour
    assert (np.abs(frame[..., None, :] - behind_glass).max(axis=-1).min(axis=-1) < 5e-3).mean() > 0.02
