"""`gsgi bake` without tracing: real command line, reader and files, but the light is the mean of the textures.

python quick_gsgi.py LOG bake SCENE -o FILE ...    # adds the scene's name to LOG if a bake gets that far
"""

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

from gsgi_files import constant

from gsgi.baker import bake, job, plan_table
from gsgi.baker.cli.main import run
from gsgi.baker.tasks import request
from gsgi.baker.views import coverage
from gsgi.runtime.file import codec


def main(log: str, *arguments: str, put: Callable[[object, str, object], object] = setattr) -> int:
    """Run the command with these arguments and return its exit code. `put(module, name, value)` sets stand-ins."""

    def make_plan(scene, *_) -> SimpleNamespace:
        settings, tracer = SimpleNamespace(target_loss=None), SimpleNamespace(cache=None)
        placement = SimpleNamespace(coverage=None, held_out={})
        inputs = {"scene": scene, "settings": settings, "triangles": SimpleNamespace(box=None)}
        return SimpleNamespace(**inputs, placement=placement, tracer=tracer, kept=None)

    def baked(made, *_) -> SimpleNamespace:
        with open(log, "a", encoding="utf-8") as file:
            file.write(made.scene.files[0].stem + "\n")
        light = sum((texture.pixels[..., :3].mean(axis=(0, 1)) for texture in made.scene.textures), start=1)
        return SimpleNamespace(
            data=codec.encode(constant(light)), attempt=SimpleNamespace(count=2, budget=2, loss=None)
        )

    for module, name, value in (
        (request, "make_plan", make_plan), (bake, "bake", baked),
        (job, "BakeRecord", SimpleNamespace(of=lambda *_: SimpleNamespace(keep=lambda *_: None))),
        (coverage, "coverage_summary", lambda _: []), (plan_table, "summary", lambda _: ""),
    ):  # fmt: skip
        put(module, name, value)
    return run([*arguments, "--quiet", "--no-evaluate", "--cache", str(Path(log).parent / "cache")])


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
