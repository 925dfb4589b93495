"""`gsgi export`: a bake in a form that other engines read, or as a page for browsers."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "export",
        run,
        "Write the light of a .gsgi file as SH probes or as Gaussians for viewers, or a scene with it as a web page.",
        "  gsgi export room.gsgi -o room.npz --probes 0.5\n"
        "  gsgi export room.gsgi -o room.json --probes 1\n"
        "  gsgi export room.gsgi -o room.ply\n"
        "  gsgi export room.gsgi -o room.splats.glb\n"
        "  gsgi export room.glb --gi room.gsgi --web site",
    )
    parser.add_argument(
        "scene", metavar="FILE", help="with --web a glTF 2.0 scene; else a .gsgi file, with --probes of `surface`"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--probes", type=shared.positive, metavar="SPACING",
                      help="write probes: distance between neighbours, m")  # fmt: skip
    what.add_argument("--web", metavar="DIR",
                      help="write a folder for any web server; it replaces a page that gsgi has written")  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="OUT",
        help="with --probes .npz or .json: SH coefficients of B, and how to read them; else .ply, or .glb with "
             "KHR_gaussian_splatting: Gaussians for viewers of 3D Gaussian splatting, which blend them along the ray. "
             "Lost are weights by normal, slopes, relief, the coarse level, light groups, and what a display does not "
             "show (sRGB, exposed to mid-grey)",
    )  # fmt: skip
    parser.add_argument("--gi", metavar="FILE", help="with --web: baked light (.gsgi)")
    shared.add_reading(parser)
    shared.add_light(parser)
    shared.add_verbosity(parser)


def run(options: argparse.Namespace) -> None:
    """Write what was asked for."""
    from gsgi.runtime.errors import UsageError

    if options.web is None:
        if options.output is None or options.gi is not None:
            raise UsageError("without --web needed is -o OUT, and FILE is the .gsgi file itself: leave out --gi")
        if options.probes is None:
            _write_splats(options)
        else:
            _write_probes(options)
    else:
        if options.gi is None or options.output is not None:
            raise UsageError("--web DIR needs --gi FILE, and is the output itself: leave out -o")
        _write_web(options)


def _write_probes(options: argparse.Namespace) -> None:
    """Read the bake, fill the grid, write it."""
    from gsgi.baker.cli.console import Console
    from gsgi.baker.progress import Progress
    from gsgi.runtime.atomic import check_writable, write_atomic
    from gsgi.runtime.errors import UnsupportedError
    from gsgi.runtime.file.reader import read_bake
    from gsgi.runtime.probes import check_path, encode, probe_grid

    check_path(options.output)
    check_writable(options.output)
    console = Console(options.quiet)
    baked = read_bake(options.scene)
    with Progress(console).stage("probes"):
        try:
            grid = probe_grid(baked, options.probes)
        except UnsupportedError as error:
            raise UnsupportedError(f"{options.scene}: {error}") from error
    data = encode(grid, options.output)
    write_atomic(options.output, data)
    shape = " x ".join(map(str, grid.sh.shape[:3]))
    console.close(f"wrote {options.output}: {shape} probes, {len(data)} bytes")


def _write_splats(options: argparse.Namespace) -> None:
    """Read the bake, and write its Gaussians as viewers have them."""
    from gsgi.baker.cli.console import Console
    from gsgi.runtime.atomic import check_writable, write_atomic
    from gsgi.runtime.errors import UsageError
    from gsgi.runtime.file.reader import read_bake
    from gsgi.runtime.splats import check_path, encode, splats_of

    check_path(options.output)
    check_writable(options.output)
    if _is_scene(options.output):
        raise UsageError(f"{options.output}: is a glTF scene, which would be overwritten: choose another name")
    splats = splats_of(read_bake(options.scene))
    data = encode(splats, options.output)
    write_atomic(options.output, data)
    shown = f"{len(splats.position)} Gaussians at exposure {splats.exposure:.3g}"
    Console(options.quiet).close(f"wrote {options.output}: {shown}, {len(data)} bytes")


def _is_scene(path: str) -> bool:
    """Whether there is a .glb file that no export has written: those begin with what wrote them."""
    from gsgi.runtime.splats import GLB_START

    try:
        with open(path, "rb") as file:
            start = file.read(256)
    except OSError:
        return False
    return start.startswith(b"glTF") and GLB_START not in start


def _write_web(options: argparse.Namespace) -> None:
    """Read scene and bake, and write the page."""
    from pathlib import Path

    from gsgi.baker.cli.baked_light import read_light
    from gsgi.baker.cli.console import Console
    from gsgi.baker.cli.inputs import choose_camera, read_scene
    from gsgi.baker.progress import Progress
    from gsgi.runtime.errors import UnsupportedError
    from gsgi.runtime.gaussians import Bake
    from gsgi.runtime.web.folder import check_folder, replacing_folder
    from gsgi.runtime.web.page import write_page

    check_folder(options.web)
    console = Console(options.quiet)
    progress = Progress(console)
    with progress.stage("scene"):
        scene = read_scene(options, progress)
        baked = read_light(options, scene, progress)
        if not isinstance(baked, Bake):
            raise UnsupportedError(f"{options.gi}: a page shows one .gsgi file, and no world")
        anywhere = {"camera": None, "eye": None, "target": None, "fov": None, "size": (1280, 720)}
        cameras = scene.cameras or {"view": choose_camera(scene, argparse.Namespace(scene=options.scene, **anywhere))}
    with progress.stage("page"), replacing_folder(options.web) as folder:
        try:
            size = write_page(folder, scene, baked, Path(options.gi).read_bytes(), cameras, Path(options.scene).stem)
        except UnsupportedError as error:
            raise UnsupportedError(f"{options.gi}: {error}") from error
    console.close(f"wrote {options.web}: a page of {size / 1e6:.1f} MB; serve the folder, e.g. python3 -m http.server")
