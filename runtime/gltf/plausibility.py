"""Warn of a valid scene that looks other than its author may expect: metals, a size in other units than metres."""

from gsgi.runtime.metals import metal_areas
from gsgi.runtime.scene import Scene

from .document import Document
from .problems import Code

METAL_SHARE = 0.05  # of all surface; below it, metals are fittings that nobody misses
LARGEST, SMALLEST = 2000.0, 0.05  # m; the diagonals of a town quarter and of a matchbox


def warn_of_metal(document: Document, scene: Scene) -> None:
    """Warn if much of the surface of a scene is metallic, with its area and the material that has most of it."""
    metal, area = metal_areas(scene)
    if metal.sum() > METAL_SHARE * area:
        name = scene.materials[metal.argmax()].name
        most = f', most of it "{name}"' if name and name.isprintable() else ""
        text = f"{metal.sum():.3g} m^2, {metal.sum() / area:.0%} of all surface, is metal{most}: it has no mirror"
        document.warn(document.root.get("materials", []), Code.METAL, f"{text} images and looks rough")


def warn_of_size(document: Document, scene: Scene) -> None:
    """Warn if a scene is so large or so small that its unit is hardly the metre."""
    extent = scene.diagonal()
    if SMALLEST <= extent <= LARGEST:
        return
    size = f"{extent / 1000:.3g} km" if extent > LARGEST else f"{extent * 1000:.3g} mm"
    text = f"the scene is {size} across: glTF counts in metres; if it was made in another unit, export it with a scale"
    document.warn(document.root, Code.SIZE, text)
