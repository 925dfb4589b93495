"""The baked light that a command shows: what --gi and --weight name, and whether it fits the scene."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from gsgi.baker.progress import Progress
from gsgi.runtime.errors import UsageError
from gsgi.runtime.gaussians import Bake, Effects
from gsgi.runtime.light_groups import Factors, factors_of
from gsgi.runtime.lighting import SUFFIX as TOML
from gsgi.runtime.scene import Scene

from .inputs import lights_file

if TYPE_CHECKING:
    from gsgi.runtime.world.world import World


def read_light(options: argparse.Namespace, scene: Scene, progress: Progress) -> "Bake | World | None":
    """Read the bake, or the manifest of a world, that --gi names.

    Warn if it was made for other geometry, or without an environment or any punctual lights where there are some now,
    or the other way round.
    """
    from gsgi.runtime.file.fingerprint import fingerprint
    from gsgi.runtime.file.reader import read_bake
    from gsgi.runtime.world.manifest import SUFFIX
    from gsgi.runtime.world.world import World

    if options.gi is None:
        return None
    baked = World(options.gi) if options.gi.endswith(SUFFIX) else read_bake(options.gi)
    if baked.scene not in (0, fingerprint(scene)):
        progress.warn(f"{options.gi}: was baked for other geometry than {options.scene}; its light may not fit")
    for line in _other_light(options, scene, baked):
        progress.warn(line)
    return baked


def _other_light(options: argparse.Namespace, scene: Scene, baked: "Bake | World") -> Iterator[str]:
    """Warnings about light that the bake has and the scene lacks, or the other way round."""
    from gsgi.baker.effects import effects

    lights = lights_file(options) or Path(options.scene).with_suffix(TOML)
    there = effects(scene)
    for effect, what in ((Effects.ENVIRONMENT, "an environment"), (Effects.PUNCTUAL, "punctual lights")):
        if baked.scene and effect in baked.effects ^ there:
            how = f"with {what}, which the scene lacks"
            if effect in there:
                how = f"without {what} (or with --ignore), which the scene has"
            yield f"{options.gi}: was baked {how}: give flags for light to all commands, or put them into {lights.name}"


def read_weights(options: argparse.Namespace, baked: "Bake | World | None") -> Factors:
    """The weights of the bake's light groups that --weight gives. Raises UsageError."""
    if not options.weight:
        return {}
    if baked is None:
        raise UsageError("--weight needs baked light: --gi FILE")
    try:
        return factors_of(baked, dict(options.weight))
    except ValueError as error:
        raise UsageError(f"{options.gi}: {error}") from None
