"""A bake for the samples that need one: made once, kept in build/samples/."""

from pathlib import Path

import gsgi

ROOT = Path(__file__).resolve().parents[1]
CORNELL = ROOT / "samples" / "scenes" / "cornell.glb"
OUT = ROOT / "build" / "samples"


def draft(scene: str | Path) -> Path:
    """The .gsgi file of a draft bake of a scene; baked at the first call, in some seconds for a small scene."""
    output = OUT / f"{Path(scene).stem}.gsgi"
    OUT.mkdir(parents=True, exist_ok=True)
    if not output.exists():
        print(f"baking {scene} to {output}")
        gsgi.bake(scene, output, quality="draft", evaluate=False)
    return output
