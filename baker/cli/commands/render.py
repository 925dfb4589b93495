"""`gsgi render`: one layer of one deferred frame."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "render",
        run,
        "Draw a scene with its baked light, headless, by a deferred OpenGL renderer.",
        "  gsgi render room.glb --gi room.gsgi -o room.png\n"
        "  gsgi render room.glb --gi room.gsgi -o b.exr --layer indirect --camera kitchen --size 1280x720\n"
        "  gsgi render room.glb --gi room.gsgi -o room.png --eye 0,1.6,3 --target 0,1,0 --fov 50\n"
        "  gsgi render room.glb --gi room.gsgi -o room.png --weight lamps=0.2 --weight sky=1,0.8,0.6\n"
        "  gsgi render level.glb --gi level.gsgi.json -o level.png --eye 0,1.6,3 --target 0,1,0  # a world of sectors\n"
        "  gsgi render room.glb --gi room.gsgi -o room.png --profile",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    shared.add_gi(parser)
    shared.add_weights(parser)
    shared.add_picture(parser)
    parser.add_argument("--backend", choices=("egl", "osmesa", "system", "auto"), default="auto",
                        help="OpenGL without a window; system: WGL, CGL, or GLX, as for windows; auto uses WGL on "
                        "Windows, CGL on macOS, else EGL, else OSMesa, and says which")  # fmt: skip
    parser.add_argument("--device", type=int, metavar="N", help="number of the EGL device to draw on, from 0")
    parser.add_argument("--profile", action="store_true",
                        help="print the driver and what each pass costs, medians of 9 frames")  # fmt: skip
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Draw and write the layer."""
    from gsgi.baker.cli.baked_light import read_light, read_weights
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import choose_camera, read_scene, warn_unless_seen, wrote
    from gsgi.baker.evaluation.pictures import write_layer
    from gsgi.baker.memory import PER_DRAWN_PIXEL, check_picture
    from gsgi.baker.progress import Progress
    from gsgi.runtime.atomic import check_apart, check_writable
    from gsgi.runtime.errors import UsageError
    from gsgi.runtime.gl.headless import costs, draw
    from gsgi.runtime.image import check_image_path
    from gsgi.runtime.world.world import World

    check_image_path(options.output)
    check_writable(options.output)
    if options.gi is None and options.layer == "indirect":
        raise UsageError("--layer indirect needs baked light: --gi FILE")
    if options.device is not None and options.backend not in ("auto", "egl"):
        raise UsageError(f"--device chooses among EGL devices: leave out --backend {options.backend}")
    console = Console(options.quiet)
    progress = Progress(console)
    memory = check_picture(options.size, PER_DRAWN_PIXEL)
    with progress.stage("scene"):
        scene = read_scene(options, progress)
        check_apart(options.output, scene.files)
        baked = read_light(options, scene, progress)
        weights = read_weights(options, baked)
        camera = choose_camera(scene, options)
        if isinstance(baked, World):
            baked.settle(camera.position)
    progress.say(memory)
    frame = scene, baked, camera, *options.size, options.backend, options.device
    with progress.stage("draw"):
        layers = draw(*frame, progress.say, [options.layer, "depth"], weights)
    warn_unless_seen(layers["depth"], progress)
    write_layer(options.output, options.layer, layers[options.layer], options.exposure)
    console.close(wrote(options, progress))
    if options.profile:
        print_costs(*costs(*frame))


def print_costs(driver: str, rows: list[dict]) -> None:
    """Print the driver, and a table of medians whose last row is the sum of all passes."""
    everything = {"name": "all", **{column: sum(row[column] for row in rows) for column in ("gpu_ms", "cpu_ms")}}
    print(driver)
    print(f"{'pass':<28}{'gpu ms':>9}{'cpu ms':>9}{'quads':>9}{'fragments':>12}")
    for row in [*rows, everything | {"quads": 0, "fragments": ""}]:
        times = f"{row['gpu_ms']:>9.2f}{row['cpu_ms']:>9.2f}"
        print(f"{row['name']:<28}{times}{row['quads'] or '':>9}{row['fragments']:>12}".rstrip())
