"""A baked scene, drawn without a display or a GPU: the frame and its indirect light, to look at and to measure.

python samples/02_render_headless.py build/box/box.glb build/box/box.gsgi build/box
"""

import sys
from pathlib import Path

from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.file import codec
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.image import write_image

WIDTH, HEIGHT = 320, 240


def main(scene_file: str, gi_file: str, folder: str) -> None:
    """Draw the scene as its first camera sees it: final.exr, final.png, indirect.exr, indirect.png."""
    scene, bake = read_gltf(scene_file), codec.decode(Path(gi_file).read_bytes())
    context = create_context("auto", say=print)  # EGL, else OSMesa; it says which
    renderer = DeferredRenderer(context, scene, bake, WIDTH, HEIGHT)
    renderer.render(next(iter(scene.cameras.values())))

    # (240, 320, 3) float32, linear radiance, row 0 on top. "indirect" is B, what was baked: not yet albedo * B.
    layers = {layer: renderer.read(layer) for layer in ("final", "indirect")}
    exposure = auto_exposure(layers["final"])  # one for both, so that they can be compared
    for layer, image in layers.items():
        write_image(Path(folder, f"{layer}.exr"), image)  # as it is, to measure
        write_image(Path(folder, f"{layer}.png"), to_uint8(tone_map(image, exposure)))  # as a display shows it
        print(f"{layer}: mean radiance {image.mean():.4f}")

    renderer.release()
    context.release()


if __name__ == "__main__":
    main(*sys.argv[1:])
