"""What each command of `gsgi` does. Heavy imports stay inside the command that needs them."""

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np

from gsgi.runtime.atomic import check_writable, write_atomic
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import FormatError, SceneError, UsageError
from gsgi.runtime.gaussians import Bake, Effects
from gsgi.runtime.image import check_image_path
from gsgi.runtime.layers import LAYERS
from gsgi.runtime.scene import Scene

from .progress import Progress
from .settings import Settings


def bake(options: argparse.Namespace) -> None:
    """Bake a scene to a .gsgi file."""
    from gsgi.runtime import codec

    from .bake import bake as run
    from .held_out import judge

    check_writable(options.output)
    if Path(options.output).resolve() == Path(options.scene).resolve():
        raise UsageError(f"{options.output}: the output would overwrite the scene")
    progress = Progress(options.quiet)
    with progress.stage("scene"):
        scene = _read_scene(options.scene, progress)
    settings = Settings(
        gaussians=options.gaussians,
        views=options.views,
        size=options.view_size,
        samples=options.samples,
        iterations=options.iterations,
        denoise=options.denoise == "auto",
        seed=options.seed,
    )
    try:
        data = run(scene, settings, progress)
    except SceneError as error:
        raise SceneError(f"{options.scene}: {error}") from error
    write_atomic(options.output, data)
    baked = codec.decode(data)
    count = len(baked.gaussians)
    progress.say(f"wrote {options.output}: {count} Gaussians, {len(data)} bytes")
    if options.quiet and not options.json:
        return  # nobody would see what it reached
    held_out = judge(scene, baked, settings.seed, progress)
    for view in held_out:
        progress.say(
            f"  {view.name}: B at PSNR {view.psnr:.2f} dB, SSIM {view.ssim:.4f} "
            f"(ceiling {view.ssim_ceiling:.4f}), FLIP {view.flip:.4f}"
        )
    if options.json:
        seconds = [{"stage": name, "seconds": round(value, 3)} for name, value in progress.seconds.items()]
        views = [dataclasses.asdict(view) for view in held_out]
        _print_json({"gaussians": count, "bytes": len(data), "stages": seconds, "held_out": views})


def render(options: argparse.Namespace) -> None:
    """Draw one layer of one frame."""
    from .pictures import write_layer

    check_image_path(options.output)
    check_writable(options.output)
    if options.gi is None and options.layer == "indirect":
        raise UsageError("--layer indirect needs baked light: --gi FILE")
    scene = _read_scene(options.scene, Progress())
    baked = None if options.gi is None else read_bake(options.gi)
    frame = draw(scene, baked, _camera(scene, options), *options.size, options.backend)
    write_layer(options.output, options.layer, frame[options.layer], options.exposure)


def reference(options: argparse.Namespace) -> None:
    """Path-trace one layer of one frame."""
    from . import reference as references
    from .irradiance import Tracer
    from .pictures import write_layer

    check_image_path(options.output)
    check_writable(options.output)
    progress = Progress(options.quiet)
    with progress.stage("scene"):
        scene = _read_scene(options.scene, progress)
        camera = _camera(scene, options)
    width, height = options.size
    with progress.stage("trace", 2 * width * height, "points") as advance:
        truth = references.trace(Tracer(scene), camera, width, height, options.samples, options.seed, advance)
    indirect = truth.clean(truth.indirect) if options.denoise else truth.indirect
    layers = {
        "final": truth.lit(indirect),
        "primary": truth.primary,
        "indirect": indirect,
        "albedo": truth.surface.albedo,
        "normal": truth.surface.normal,
        "depth": truth.surface.depth,
    }
    write_layer(options.output, options.layer, layers[options.layer], options.exposure)


def compare(options: argparse.Namespace) -> None:
    """Print the difference between two images."""
    from gsgi.runtime.image import read_image

    from .metrics import WINDOW, compare_display, compare_linear

    kinds = {Path(path).suffix.lower() for path in (options.image, options.reference)}
    if len(kinds) > 1:
        raise UsageError(f"cannot compare {' with '.join(sorted(kinds))}: one is linear light, the other a picture")
    image, truth = read_image(options.image), read_image(options.reference)
    if image.shape != truth.shape:
        sizes = [f"{a.shape[1]}x{a.shape[0]}" for a in (image, truth)]
        raise UsageError(f"images differ in size: {options.image} is {sizes[0]}, {options.reference} is {sizes[1]}")
    if min(image.shape[:2]) < WINDOW:
        raise UsageError(f"{options.image}: SSIM needs an image of at least {WINDOW}x{WINDOW} pixels")
    linear = kinds == {".exr"}
    difference = compare_linear(image, truth, truth, truth) if linear else compare_display(image, truth)
    if options.json:
        _print_json(dataclasses.asdict(difference))
    else:
        print(f"PSNR {difference.psnr:.2f} dB\nSSIM {difference.ssim:.4f}\nFLIP {difference.flip:.4f}")


def inspect(options: argparse.Namespace) -> None:
    """Print what a .gsgi file holds."""
    from gsgi.runtime import codec

    baked = read_bake(options.file)
    gaussians = baked.gaussians
    facts = {
        "version": codec.VERSION,
        "gaussians": len(gaussians),
        "bytes": Path(options.file).stat().st_size,
        "sh_degree": gaussians.sh_degree,
        "operator": "over",
        "effects": [effect.name.lower() for effect in Effects if effect in baked.effects],
        **{name: round(value, 9) for name, value in dataclasses.asdict(baked.blend).items()},
        "tone_scale": baked.tone_scale,
    }
    if len(gaussians):
        facts |= {
            "bounds": [gaussians.position.min(axis=0).tolist(), gaussians.position.max(axis=0).tolist()],
            "scale": [float(gaussians.scale.min()), float(gaussians.scale.max())],
            "opacity": [float(gaussians.opacity.min()), float(gaussians.opacity.max())],
        }
    if options.json:
        _print_json(facts)
        return
    for name, value in facts.items():
        print(f"{name.replace('_', ' '):<10} {_plain(value)}")


def doctor(options: argparse.Namespace) -> int:
    """Print what works here; exit code 5 if a bake or a frame could not be made."""
    from .doctor import examine

    checks = examine()
    if options.json:
        _print_json([dataclasses.asdict(check) for check in checks])
    else:
        for check in checks:
            print(f"{'ok ' if check.works else '-- '} {check.name:<10} {check.detail}")
            if check.advice:
                print(f"    {'':<10} {check.advice}")
    return 0 if all(check.works for check in checks if check.needed) else 5


def read_bake(path: str) -> Bake:
    """The bake in a .gsgi file. Raises FileError or FormatError, both naming the file."""
    from gsgi.runtime import codec
    from gsgi.runtime.glb import read_file

    try:
        return codec.decode(read_file(Path(path)))
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error


def draw(scene: Scene, baked: Bake | None, camera: Camera, width: int, height: int, backend: str) -> dict:
    """Every layer of one deferred frame: name -> (H, W, 3) float32, depth (H, W)."""
    from gsgi.runtime.context import create_context
    from gsgi.runtime.renderer import DeferredRenderer

    context = create_context(backend)
    renderer = DeferredRenderer(context, scene, baked, width, height)
    try:
        renderer.render(camera)
        return {layer: renderer.read(layer) for layer in LAYERS}
    finally:
        renderer.release()
        context.release()


def _read_scene(path: str, progress: Progress) -> Scene:
    from gsgi.runtime.gltf import read_gltf

    scene = read_gltf(path)
    for warning in scene.warnings:
        progress.say(f"warning: {warning}")
    return scene


def _camera(scene: Scene, options: argparse.Namespace) -> Camera:
    """The camera that is asked for; without a name the scene's first, or one placed where it sees much."""
    if options.camera is not None:
        if options.camera not in scene.cameras:
            known = ", ".join(scene.cameras) or "none"
            raise UsageError(f"{options.scene}: expected the name of a camera ({known}), got {options.camera!r}")
        return scene.cameras[options.camera]
    if scene.cameras:
        return next(iter(scene.cameras.values()))
    from .surface_points import Triangles
    from .views import place

    return place(Triangles(scene), scene.diagonal(), 1, seed=0)[0]


def _plain(value) -> str:
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _print_json(value) -> None:
    def convert(item):
        return item.item() if isinstance(item, np.generic) else str(item)

    print(json.dumps(value, indent=2, default=convert))
