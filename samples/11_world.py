"""A world in sectors, baked and then flown through: light comes and goes with the camera, within a budget of memory.

python samples/11_world.py [FOLDER]    # default: build/samples/world, with a strip of pictures, flight.png
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from draft import OUT

import gsgi
from gsgi.runtime.display import to_uint8, tone_map
from gsgi.runtime.image import write_image

SCENE = Path(__file__).parent / "scenes" / "corridor.glb"
SECTOR = 10.5  # m; the corridor is twice as long
SIZE, SECONDS = (200, 150), 1 / 60  # of a picture, px; of a frame
EXPOSURE = 3.0


def main(folder: str | Path = OUT / "world", settings: gsgi.Settings | None = None) -> None:
    """Bake, fly from one end to the other with room for one sector alone, and write a strip of pictures."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    manifest = folder / "corridor.gsgi.json"
    gsgi.bake_world(SCENE, manifest, SECTOR, settings=settings or gsgi.Settings(quality="draft"), evaluate=False)
    scene, ctx = gsgi.read_scene(SCENE), gsgi.create_context()
    with gsgi.World(manifest) as all_of_it:
        largest = max(sector.memory for sector in all_of_it.manifest.sectors)
    with gsgi.World(manifest, budget=largest) as world:
        renderer, strip = gsgi.DeferredRenderer(ctx, scene, world, *SIZE), []
        low, high = (bound[2] for bound in scene.bounds())
        for z in np.linspace(low + 1.5, high - 1.5, 6):
            camera = next(iter(scene.cameras.values()))
            pose = camera.world_from_view.copy()
            pose[2, 3] = z
            world.update(pose[:3, 3], SECONDS)
            while (
                world.changing
            ):  # frames while the camera stays here: one sector fades out, another loads and fades in
                world.update(pose[:3, 3], SECONDS)
            renderer.render(replace(camera, world_from_view=pose))
            strip.append(renderer.read("final"))
            print(f"at {z:6.1f} m: sectors {sorted(world.resident)}, {world.memory} of {world.budget} bytes")
        renderer.release()
    write_image(folder / "flight.png", to_uint8(tone_map(np.concatenate(strip, axis=1), EXPOSURE)))


if __name__ == "__main__":
    main(*sys.argv[1:])
