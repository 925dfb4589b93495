"""Draw the Cornell box in Panda3D with simplepbr, without and with baked light, side by side in a PNG.

python samples/07_panda3d.py [GI PICTURE]    # default: a draft bake, build/samples/panda3d.png
"""

import sys
from math import pi

import numpy as np
import simplepbr
from direct.showbase.ShowBase import ShowBase
from draft import CORNELL, OUT, draft
from panda3d.core import Filename, load_prc_file_data
from PIL import Image

from gsgi.runtime.panda3d import BakedLight

# No window: of Panda3D's displays the one that needs no screen, and no sound.
load_prc_file_data("", "load-display p3headlessgl\nwindow-type offscreen\nwin-size 320 320\naudio-library-name null")


def main(gi=None, picture=OUT / "panda3d.png") -> None:
    """Draw both pictures through the file's first camera."""
    base = ShowBase()
    simplepbr.init(enable_shadows=False, exposure=1)
    room = base.loader.load_model(Filename.from_os_specific(str(CORNELL)))
    room.reparent_to(base.render)
    for lamp in room.find_all_matches("**/+Spotlight"):
        lamp.node().color = lamp.node().color * (683 / (4 * pi))  # in glTF's units again
    camera = room.find("**/+Camera")
    base.camLens.set_fov(camera.node().get_lens().fov)
    base.camLens.set_near_far(0.01, 10)
    base.cam.set_mat(camera.get_mat(base.render))

    images = [frame(base)]
    light = BakedLight(gi or draft(CORNELL), room)
    light.attach(base.cam)
    images.append(frame(base))
    Image.fromarray(np.hstack(images)).save(picture)


def frame(base: ShowBase) -> np.ndarray:
    """What the window shows next, (H, W, 3) uint8, row 0 on top."""
    base.task_mgr.step()
    shot = base.win.get_screenshot()
    return np.frombuffer(shot.get_ram_image_as("RGB"), np.uint8).reshape(shot.y_size, shot.x_size, 3)[::-1]


if __name__ == "__main__":
    main(*sys.argv[1:])
