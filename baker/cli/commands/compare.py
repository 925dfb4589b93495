"""`gsgi compare`: the difference between two images."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "compare",
        run,
        "Print PSNR, SSIM and FLIP of two images of one size. EXR is linear light; the reference sets its exposure.",
        "  gsgi compare frame.exr truth.exr\n  gsgi compare frame.png golden.png --json",
    )
    parser.add_argument("image", metavar="A", help="the image to judge: .exr or .png")
    parser.add_argument("reference", metavar="B", help="the reference, of the same kind and size")
    shared.add_json(parser)


def run(options: argparse.Namespace) -> None:
    """Read both and print the three figures."""
    import dataclasses

    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.evaluation.metrics import WINDOW, compare_display, compare_linear
    from gsgi.runtime.errors import UsageError
    from gsgi.runtime.image import check_image_path, read_image

    kinds = {check_image_path(path) for path in (options.image, options.reference)}
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
        print_json(dataclasses.asdict(difference))
    else:
        print(f"PSNR {difference.psnr:.2f} dB\nSSIM {difference.ssim:.4f}\nFLIP {difference.flip:.4f}")
