"""Draw a baked scene without a display or a GPU: the frame and its indirect light, to look at and to measure.

python samples/02_render_headless.py [SCENE GI FOLDER]    # default: the Cornell box, a draft bake, build/samples
"""

import sys
from pathlib import Path

from draft import CORNELL, OUT, draft

import gsgi
from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.image import write_image

WIDTH, HEIGHT = 320, 240


def main(scene_file: str | Path = CORNELL, gi_file: str | None = None, folder: str | Path = OUT) -> None:
    """Draw the scene from its first camera: final.exr, final.png, indirect.exr, indirect.png."""
    scene, bake = gsgi.read_scene(scene_file), gsgi.read_bake(gi_file or draft(scene_file))
    context = gsgi.create_context("auto", say=print)  # EGL, else OSMesa; it says which
    renderer = gsgi.DeferredRenderer(context, scene, bake, WIDTH, HEIGHT)
    renderer.render(next(iter(scene.cameras.values())))

    # (240, 320, 3) float32, linear radiance, row 0 at the top. "indirect" is the baked B, not albedo * B.
    layers = {layer: renderer.read(layer) for layer in ("final", "indirect")}
    exposure = auto_exposure(layers["final"])  # one for both, so that they can be compared
    for layer, image in layers.items():
        write_image(Path(folder, f"{layer}.exr"), image)  # linear, to measure
        write_image(Path(folder, f"{layer}.png"), to_uint8(tone_map(image, exposure)))  # as a display shows it
        print(f"{layer}: mean radiance {image.mean():.4f}, {Path(folder, layer)}.png")

    renderer.release()
    context.release()


if __name__ == "__main__":
    main(*sys.argv[1:])
