"""`gsgi view`: a window to fly through a scene with its baked light."""

import argparse

from gsgi.baker.cli import options as shared
from gsgi.runtime.viewer.controls import HELP


def add(commands) -> None:
    """Declare the command."""
    keys = "\n".join(f"  {line}" for line in HELP.splitlines())
    parser = shared.command(
        commands,
        "view",
        run,
        "Fly through a scene with its baked light, in a window.",
        "  gsgi view room.glb --gi room.gsgi\n"
        "  gsgi view room.glb --gi room.gsgi --camera kitchen --size 1920x1080\n"
        "  gsgi view room.glb --eye 0,1.6,3 --target 0,1,0        # the flags that F prints\n"
        "  gsgi view level.glb --gi level.gsgi.json               # sectors of a world follow the camera\n"
        f"  gsgi view room.glb --sun 140,35\n\nkeys:\n{keys}",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    shared.add_gi(parser)
    shared.add_camera(parser, "1280x720")


def run(options: argparse.Namespace) -> None:
    """Open the window, and return when it is closed."""
    from pathlib import Path

    from gsgi.baker.cli.baked_light import read_light
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import choose_camera, read_scene
    from gsgi.baker.memory import PER_DRAWN_PIXEL, check_picture
    from gsgi.baker.progress import Progress
    from gsgi.runtime.viewer.window import Viewer

    check_picture(options.size, PER_DRAWN_PIXEL)
    progress = Progress(Console())
    scene = read_scene(options, progress)
    baked = read_light(options, scene, progress)
    camera = choose_camera(scene, options)
    Viewer(scene, baked, camera, options.size, Path(options.scene).stem, progress.say, options.exposure).run()
