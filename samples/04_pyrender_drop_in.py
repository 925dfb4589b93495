"""The Cornell box through pyrender's calls, without and with baked light, side by side in a PNG.

./dev demo  # bakes build/demo/cornell.gsgi
.venv/bin/python samples/04_pyrender_drop_in.py build/demo/cornell.gsgi cornell.png
"""

import argparse
from pathlib import Path

import numpy as np
import pyrender
import trimesh
from PIL import Image

# The one import that changes: the class is pyrender's otherwise.
from gsgi.runtime.pyrender import OffscreenRenderer

SCENE = Path(__file__).parent / "scenes" / "cornell.glb"


def cornell() -> pyrender.Scene:
    """The box with the light and the camera of its glTF file, which trimesh does not hand on."""
    scene = pyrender.Scene.from_trimesh_scene(trimesh.load_scene(SCENE), bg_color=(0.0, 0.0, 0.0, 1.0))
    lamp = np.eye(4)
    lamp[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # looks down -Y
    lamp[:3, 3] = 0.0, 0.5438, -0.2795
    angles = {"innerConeAngle": np.radians(55), "outerConeAngle": np.radians(75)}
    scene.add(pyrender.SpotLight((1.0, 0.9, 0.75), 1.2, **angles), pose=lamp)
    camera = np.eye(4)
    camera[:3, 3] = 0.0, 0.273, 0.8
    scene.add(pyrender.PerspectiveCamera(0.6860479, znear=0.01), pose=camera)
    return scene


def main() -> None:
    """Draw both pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bake", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--size", type=int, default=512, help="edge of a picture, px")
    args = parser.parse_args()

    scene, pictures = cornell(), []
    for gi in (None, args.bake):
        renderer = OffscreenRenderer(args.size, args.size, gi=gi)
        color, _depth = renderer.render(scene, pyrender.RenderFlags.SHADOWS_SPOT)
        renderer.delete()
        pictures.append(color)
    Image.fromarray(np.hstack(pictures)).save(args.picture)


if __name__ == "__main__":
    main()
