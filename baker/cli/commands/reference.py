"""`gsgi reference`: one layer of one path-traced image."""

import argparse
from typing import TYPE_CHECKING

from gsgi.baker.cli import options as shared

if TYPE_CHECKING:
    import numpy as np

    from gsgi.baker.trace.reference import Reference

LOST_MAX = 0.05  # share of B that the denoiser may leave out unsaid


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "reference",
        run,
        "Path-trace with Mitsuba what `gsgi render` approximates: the same cameras, sizes and layers.",
        "  gsgi reference room.glb -o truth.exr --samples 4096\n"
        "  gsgi reference room.glb -o truth.png --camera kitchen --size 1280x720\n"
        "  gsgi reference room.glb -o truth.png --eye 0,1.6,3 --target 0,1,0 --fov 50",
    )
    shared.add_scene(parser)
    shared.add_light(parser)
    shared.add_picture(parser)
    parser.add_argument(
        "--samples",
        type=shared.whole(2, 2**20),
        default=1024,
        metavar="N",
        help="paths per pixel, and as many for each blended surface in it",
    )
    parser.add_argument("--denoise", action="store_true", help="denoise B; not for measurements")
    parser.add_argument("--seed", type=shared.whole(0, 2**30), default=0, metavar="N", help="random seed of the paths")
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Trace and write the layer."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import choose_camera, read_scene, wrote
    from gsgi.baker.evaluation.pictures import write_layer
    from gsgi.baker.memory import PER_BLENDED_PIXEL, PER_TRACED_PIXEL, check_picture
    from gsgi.baker.progress import Progress
    from gsgi.runtime.atomic import check_apart, check_writable
    from gsgi.runtime.image import check_image_path

    check_image_path(options.output)
    check_writable(options.output)
    console = Console(options.quiet)
    progress = Progress(console)
    with progress.stage("scene"):
        scene = read_scene(options, progress)
        check_apart(options.output, scene.files)
        camera = choose_camera(scene, options)
    blends = scene.blended and options.layer == "final"
    progress.say(check_picture(options.size, PER_BLENDED_PIXEL if blends else PER_TRACED_PIXEL))
    with progress.stage("trace", _points(options.layer, scene, options.size), "points") as advance:
        layer = _traced(options, scene, camera, progress, advance)
    write_layer(options.output, options.layer, layer, options.exposure)
    console.close(wrote(options, progress))


def _points(layer: str, scene, size: tuple[int, int]) -> int:
    """Most points at which B is traced, by half."""
    from gsgi.runtime.scene import BLENDED_MOST

    surfaces = {"final": 1 + BLENDED_MOST * bool(scene.blended), "indirect": 1}
    return 2 * surfaces.get(layer, 0) * size[0] * size[1]


def _traced(options: argparse.Namespace, scene, camera, progress, advance):
    """Trace what the layer needs, and no more: (H, W, 3) float32, depth (H, W)."""
    from gsgi.baker.cli.inputs import warn_unless_seen
    from gsgi.baker.trace import reference
    from gsgi.baker.trace.blended import BlendedView
    from gsgi.baker.trace.tracer import Tracer

    tracer = Tracer(scene)
    view = BlendedView(tracer, scene, camera, *options.size)
    surface, paths = view.solid, (options.samples, options.seed)
    warn_unless_seen(surface.depth, progress)

    def indirect(truth: "Reference") -> "np.ndarray":
        if not options.denoise:
            return truth.indirect
        if (lost := truth.lost) > LOST_MAX:
            few = "which few paths brought as bright dots: trace more of them (--samples)"
            progress.warn(f"the denoiser has left out {lost:.0%} of the indirect light, {few}")
        return truth.clean

    if options.layer == "final":
        return view.final(*paths, indirect, advance)
    if options.layer == "indirect":
        return indirect(reference.on_surface(tracer, surface, *paths, advance))
    if options.layer == "primary":
        return reference.primary(tracer, surface)
    return {"albedo": surface.albedo, "normal": surface.shading_normal, "depth": surface.depth}[options.layer]
