"""One bake, many hours: three suns, the sky and a lamp are baked apart and weighed anew in each frame.

python samples/10_light_groups.py [FOLDER]    # leaves room.glb, room.gsgi, hours.png, day.gif; default: build/samples
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from draft import OUT
from glb_writer import Glb
from make_scenes import box, level, reveal, table, wall

import gsgi
from gsgi.runtime.display import to_uint8, tone_map
from gsgi.runtime.image import write_image
from gsgi.runtime.lighting import light

SUNS = {"14 h": (235, 50), "16 h": (262, 33), "18 h": (285, 14)}  # azimuth and elevation, degrees
DUSK = (1, 0.55, 0.3)  # colour of the last sun
HOURS = {  # weights of the light groups; the afternoon between two suns is a blend of both
    "14 h": {"14 h": 1, "sky": 1},
    "15 h": {"14 h": 0.5, "16 h": 0.5, "sky": 1},
    "16 h": {"16 h": 1, "sky": 1},
    "18 h": {"18 h": DUSK, "sky": (0.4, 0.3, 0.35)},
    "20 h": {"sky": (0.03, 0.04, 0.08), "lamp": 1},
}
SIZE = 320, 240
FRAMES, PER_SECOND = 25, 8  # of the animation, four for each hour


def write_room(file: Path) -> None:
    """Write a room of 4 x 2.6 x 4 m with a window to the west, a red wall, a table, a lamp and a camera."""
    glb, window = Glb(), (-3.0, -1.4, 0.9, 2.2)
    plaster, red, wood = (
        glb.material(name, color)
        for name, color in (("plaster", (0.75, 0.73, 0.7)), ("red", (0.6, 0.15, 0.1)), ("wood", (0.5, 0.32, 0.18)))
    )
    x, z = (-2, 2), (-4, 0)
    inside = wall(-2, z, 2.6, 2, [window]) + wall(0, x, 2.6, -4, axis="z") + wall(2, z, 2.6, -2)
    inside += [level(x, z, 2.6, down=True), *reveal((-2.2, -2), window), level((-2.2, -2), window[:2], 0.9)]
    x, z = (-2.2, 2.2), (-4.2, 0.2)  # walls are 20 cm thick
    outside = [*wall(-2.2, z, 2.8, -9, [window]), level(x, z, 2.8)]
    outside += wall(0.2, x, 2.8, 9, axis="z") + wall(-4.2, x, 2.8, -9, axis="z")
    glb.solid("shell", inside + outside, plaster)
    glb.solid("red wall", wall(-4, (-2, 2), 2.6, 0, axis="z"), red)
    glb.solid("floor", [level((-2, 2), (-4, 0), 0)], wood)
    glb.solid("furniture", table(0.2, -2.6) + box((1.2, 0, -3.9), (1.95, 1.6, -3.2)), plaster)
    glb.light("lamp", (0.2, 1.5, -2.6), (0, 0, 0, 1), type="point", color=[1, 0.75, 0.5], intensity=1.5)
    glb.camera("corner", (1.7, 1.6, -0.2), (-0.7, 0.9, -2.8), 1.0)
    file.write_bytes(glb.encode())


def weights_of_the_day(groups: Sequence[str], count: int) -> list[dict[str, tuple[float, ...]]]:
    """The weights of all groups at `count` times of the day, blends of those at HOURS before and after."""
    hours = [int(name.split()[0]) for name in HOURS]
    at = np.array([[np.broadcast_to(weights.get(group, 0), 3) for group in groups] for weights in HOURS.values()])
    times = np.linspace(hours[0], hours[-1], count)
    blends = np.stack([np.interp(times, hours, each) for each in at.reshape(len(hours), -1).T], axis=1)
    return [dict(zip(groups, map(tuple, blend.reshape(-1, 3)), strict=True)) for blend in blends]


def write_animation(file: Path, pictures: Sequence[np.ndarray]) -> None:
    """Write pictures (H, W, 3) uint8 as a GIF of half their size."""
    height, width = SIZE[1] // 2, SIZE[0] // 2
    halves = [picture.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)).astype(np.uint8) for picture in pictures]
    spec = oiio.ImageSpec(width, height, 3, "uint8")
    spec.attribute("FramesPerSecond", oiio.TypeDesc("rational"), (PER_SECOND, 1))
    output = oiio.ImageOutput.create("gif")
    output.open(str(file), (spec,) * len(halves))
    for number, half in enumerate(halves):
        if number:
            output.open(str(file), spec, "AppendSubimage")
        output.write_image(half)
    output.close()


def main(folder: str | Path = OUT, settings: gsgi.Settings = gsgi.Settings(quality="draft")) -> None:  # noqa: B008
    """Write, bake once, draw each hour and the day."""
    file = Path(folder, "room.glb")
    file.parent.mkdir(parents=True, exist_ok=True)
    write_room(file)
    scene = light(gsgi.read_scene(file), gsgi.Lighting(env=(0.5, 0.7, 1.0)))
    for name, angles in SUNS.items():
        *others, sun = light(scene, gsgi.Lighting(sun=angles)).lights
        scene = replace(scene, lights=(*others, replace(sun, name=name)))
    groups = {name: (name,) for name in (*SUNS, "lamp")} | {"sky": ("environment",)}
    scene = replace(scene, groups=groups)
    gsgi.bake(scene, file.with_suffix(".gsgi"), settings=settings, evaluate=False)

    context = gsgi.create_context()
    renderer = gsgi.DeferredRenderer(context, scene, gsgi.read_bake(file.with_suffix(".gsgi")), *SIZE)

    def picture(weights: dict) -> np.ndarray:
        renderer.weights = dict.fromkeys(groups, 0) | weights  # all that is not named is off
        renderer.render(scene.cameras["corner"])
        return to_uint8(tone_map(renderer.read("final"), exposure=1.5))

    write_image(file.with_name("hours.png"), np.concatenate([picture(weights) for weights in HOURS.values()], axis=1))
    write_animation(file.with_name("day.gif"), [picture(weights) for weights in weights_of_the_day([*groups], FRAMES)])
    renderer.release()
    context.release()


if __name__ == "__main__":
    main(*sys.argv[1:])
