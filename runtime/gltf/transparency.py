"""Replace partly transparent materials, because no part of gsgi lets light pass through a surface."""

from typing import NamedTuple

from .document import Document
from .json_value import Json
from .problems import Code

MODES = ("cutout", "opaque", "absent")
TRANSMISSION = "KHR_materials_transmission"
CUTOFF = 0.5
DEALT = {
    "cutout": f"a hole where its opacity is below {CUTOFF} (see --transparent)",
    "opaque": "counts as opaque (see --transparent)",
    "absent": "is left out (see --transparent)",
}


class Opacity(NamedTuple):
    """Factor on alpha, and the cutoff below which a point is a hole; the cutoff is None if alpha has no effect."""

    factor: float
    cutoff: float | None


def read(document: Document, material: Json, mode: str) -> Opacity | None:
    """The effect of a material's alpha; None if its surfaces are left out.

    `mode` (one of MODES) determines how partly transparent materials are replaced. Opacity is alpha (1 for OPAQUE
    materials) times the share of light that KHR_materials_transmission does not transmit. Warns about each blended
    and each transmissive material.
    """
    alpha = material.get("alphaMode", "OPAQUE").choice("OPAQUE", "MASK", "BLEND")
    cutoff = material.get("alphaCutoff", 0.5).number(low=0) if alpha == "MASK" else None
    opaque = 1 - _transmission(document, material)
    if alpha == "BLEND":
        document.warn(material.get("alphaMode"), Code.TRANSPARENT, f"{_name(material)} is blended: {DEALT[mode]}")
    if opaque < 1:
        document.warn(material, Code.TRANSPARENT, f"{_name(material)} transmits light: {DEALT[mode]}")
    if alpha != "BLEND" and opaque == 1:
        return Opacity(1.0, cutoff)
    if mode == "absent" or (mode == "cutout" and opaque < CUTOFF):
        return None
    if alpha == "BLEND" and mode == "cutout":
        return Opacity(opaque, CUTOFF)
    return Opacity(1.0, cutoff)


def _transmission(document: Document, material: Json) -> float:
    extension = material.extension(TRANSMISSION)
    if extension is None:
        return 0.0
    factor = extension.get("transmissionFactor", 0).number(0, 1)
    if factor and "transmissionTexture" in extension:
        place = extension.get("transmissionTexture")
        document.warn(place, Code.SIMPLIFIED, "the transmission texture is ignored: its factor counts everywhere")
    return factor


def _name(material: Json) -> str:
    """The name of the material in quotes, or "the material" if it has none that can be printed."""
    name = material.get("name", "").string()
    return f'"{name}"' if name and name.isprintable() else "the material"
