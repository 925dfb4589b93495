"""Draw the Cornell box with pyrender's API, without and with baked light, side by side in a PNG.

python samples/04_pyrender_drop_in.py [GI PICTURE]    # default: a draft bake, build/samples/pyrender.png
"""

import argparse
from pathlib import Path

import numpy as np
import pyrender
import trimesh
from draft import CORNELL, OUT, draft
from PIL import Image

# The only import that changes: pyrender's own class has the same name.
from gsgi.runtime.pyrender import OffscreenRenderer


def cornell() -> pyrender.Scene:
    """The box with the light and the camera of its glTF file, which trimesh does not load."""
    scene = pyrender.Scene.from_trimesh_scene(trimesh.load_scene(CORNELL), bg_color=(0.0, 0.0, 0.0, 1.0))
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
    parser.add_argument("bake", type=Path, nargs="?", help="default: a draft bake of the scene")
    parser.add_argument("picture", type=Path, nargs="?", default=OUT / "pyrender.png")
    parser.add_argument("--size", type=int, default=512, help="edge of a picture, px")
    args = parser.parse_args()

    scene, pictures = cornell(), []
    for gi in (None, args.bake or draft(CORNELL)):
        renderer = OffscreenRenderer(args.size, args.size, gi=gi)
        color, _depth = renderer.render(scene, pyrender.RenderFlags.SHADOWS_SPOT)
        renderer.delete()
        pictures.append(color)
    Image.fromarray(np.hstack(pictures)).save(args.picture)


if __name__ == "__main__":
    main()
