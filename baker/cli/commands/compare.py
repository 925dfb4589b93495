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
        "  gsgi compare frame.exr truth.exr\n  gsgi compare frame.png golden.png --json\n"
        "  gsgi compare frame.png golden.png --min-ssim 0.98 --max-flip 0.05      # for CI",
    )
    parser.add_argument("image", metavar="A", help="the image to judge: .exr or .png")
    parser.add_argument("reference", metavar="B", help="the reference, of the same kind and size")
    parser.add_argument("--min-ssim", type=shared.number(0, 1), metavar="X", help="exit with 6 if SSIM is below X")
    parser.add_argument("--max-flip", type=shared.number(0, 1), metavar="X", help="exit with 6 if FLIP is above X")
    shared.add_json(parser)


def run(options: argparse.Namespace) -> None:
    """Read both, print the three figures, and judge them if limits are given."""
    import dataclasses

    from gsgi.baker.cli.json_output import print_json
    from gsgi.baker.evaluation.metrics import WINDOW, compare_display, compare_linear
    from gsgi.runtime.errors import TargetError, UsageError
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
    if options.min_ssim is not None and not difference.ssim >= options.min_ssim:
        raise TargetError(f"{options.image}: SSIM {difference.ssim:.4f} is below {options.min_ssim:g}")
    if options.max_flip is not None and not difference.flip <= options.max_flip:
        raise TargetError(f"{options.image}: FLIP {difference.flip:.4f} is above {options.max_flip:g}")
