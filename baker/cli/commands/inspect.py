"""`gsgi inspect`: what a .gsgi file holds, or a world."""

import argparse
from pathlib import Path

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "inspect",
        run,
        "Show what a .gsgi file holds, or a world, all of whose files are checked.",
        "  gsgi inspect room.gsgi\n  gsgi inspect room.gsgi --json\n  gsgi inspect level.gsgi.json",
    )
    parser.add_argument("file", metavar="FILE", help="a .gsgi file, or the .json manifest of a world")
    shared.add_json(parser)


def run(options: argparse.Namespace) -> None:
    """Print the facts, one per line or as JSON."""
    from gsgi.baker.cli.json_output import print_json
    from gsgi.runtime.file.reader import read_bake
    from gsgi.runtime.world.manifest import SUFFIX, read_manifest

    if options.file.endswith(SUFFIX):
        facts = _world_facts(read_manifest(options.file))
    else:
        facts = _facts(read_bake(options.file), Path(options.file).read_bytes())
    if options.json:
        print_json(facts)
        return
    width = max(map(len, facts))
    for name, value in facts.items():
        print(f"{name.replace('_', ' '):<{width}} {_plain(value)}")


def _facts(baked, data: bytes) -> dict:
    import dataclasses

    from gsgi.runtime.file import codec
    from gsgi.runtime.gaussians import Effects
    from gsgi.runtime.light_groups import group_names

    facts = {
        "version": codec.version(data),
        "bytes": len(data),
        "operator": codec.OPERATOR_NAMES[type(baked.blend)],
        "effects": [effect.name.lower() for effect in Effects if effect in baked.effects],
        **{name: round(value, 9) for name, value in dataclasses.asdict(baked.blend).items()},
        "tone_scale": baked.tone_scale,
        "bounces": baked.bounces or None,
        "scene": f"{baked.scene:016x}" if baked.scene else None,
        **_level(baked.gaussians),
        "relief": baked.gaussians.bumpy,
    }
    if baked.groups:
        facts["light_groups"] = list(group_names(baked))
    if baked.coarse is not None:
        facts |= {f"coarse_{name}": value for name, value in _level(baked.coarse).items()}
    return facts


def _world_facts(manifest) -> dict:
    """The facts of a world. Every file is read, and its hash compared."""
    from gsgi.runtime.gaussians import Effects
    from gsgi.runtime.world.manifest import VERSION

    bakes = [manifest.read(number) for number in range(len(manifest.sectors))]
    return {
        "version": VERSION,
        "sectors": len(bakes),
        "bytes": sum(sector.bytes for sector in manifest.sectors),
        "memory": sum(sector.memory for sector in manifest.sectors),
        "effects": [effect.name.lower() for effect in Effects if effect in manifest.effects],
        "scene": f"{manifest.scene:016x}" if manifest.scene else None,
        "margin": manifest.margin,
        "gaussians": sum(len(bake.gaussians) for bake in bakes),
        "coarse_gaussians": sum(len(bake.coarse) for bake in bakes),
        "bounds": [manifest.boxes[:, 0].min(axis=0).tolist(), manifest.boxes[:, 1].max(axis=0).tolist()],
    }


def _level(gaussians) -> dict:
    facts = {"gaussians": len(gaussians), "sh_degree": gaussians.sh_degree, "basis": gaussians.basis}
    if len(gaussians):
        facts |= {
            "bounds": [gaussians.position.min(axis=0).tolist(), gaussians.position.max(axis=0).tolist()],
            "scale": [float(gaussians.scale.min()), float(gaussians.scale.max())],
            "opacity": [float(gaussians.opacity.min()), float(gaussians.opacity.max())],
        }
    return facts


def _plain(value) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
