"""What partly transparent materials are to light, and to frames, which blend them."""

import math
from dataclasses import replace
from typing import NamedTuple

from gsgi.runtime.constants import ALPHA_MIN
from gsgi.runtime.scene import CUTOFF, Filter

from .document import Document
from .json_value import Json
from .problems import Code

MODES = ("filter", "stain", "shade", "cutout", "opaque", "absent")
TRANSMISSION = "KHR_materials_transmission"
DEALT = {
    "filter": "baked light passes it in part, and where it is clear it casts no shadow (see --transparent)",
    "stain": "baked light passes it in part, tinted, and where it is clear it casts no shadow (see --transparent)",
    "shade": "baked light passes it in part (see --transparent)",
    "cutout": f"to baked light it is a hole where its opacity is below {CUTOFF} (see --transparent)",
    "opaque": "to baked light it is opaque (see --transparent)",
    "absent": "baked light passes it by (see --transparent)",
}

# Least share of light, in its weakest channel, that a clear surface lets through. Lamps and the sun shine through panes
# as sharp as they are, while what is part of B is as soft as the Gaussians.
CLEAR = 2 / 3


class Opacity(NamedTuple):
    """Factor on alpha, and the cutoff below which a point is a hole; the cutoff is None if there are no holes.

    `blends`: alpha is the share by which frames blend the surface over what is behind it. `stand_in`: it is what light
    meets of such a surface, and frames do not show it; its `filter` says what it lets through. `tint`: how far the base
    colour tints what frames show behind it.
    """

    factor: float
    cutoff: float | None
    blends: bool = False
    stand_in: bool = False
    filter: Filter | None = None
    tint: float = 0.0

    @property
    def counts(self) -> bool:
        """Whether alpha has an effect at all."""
        return self.blends or self.cutoff is not None


def read(document: Document, material: Json, mode: str, tint: float) -> tuple[Opacity, ...]:
    """The effect of a material's alpha; what is partly transparent has one on light, or none, and one on frames.

    `mode` (one of MODES) says what partly transparent materials are to light. Opacity is alpha (1 for OPAQUE materials)
    times the share of light that KHR_materials_transmission does not transmit. `tint` is the least that the base colour
    leaves of a channel. Warns about each blended and each transmissive material.
    """
    alpha = material.get("alphaMode", "OPAQUE").choice("OPAQUE", "MASK", "BLEND")
    cutoff = material.get("alphaCutoff", 0.5).number(low=0) if alpha == "MASK" else None
    opaque = 1 - _transmission(document, material)
    if alpha == "BLEND":
        document.warn(material.get("alphaMode"), Code.TRANSPARENT, f"{_name(material)} is blended: {DEALT[mode]}")
    if opaque < 1:
        document.warn(material, Code.TRANSPARENT, f"{_name(material)} transmits light: {DEALT[mode]}")
    if alpha != "BLEND" and opaque == 1:
        return (Opacity(1.0, cutoff),)
    shown = 1 - opaque if alpha == "BLEND" and mode != "stain" else 1.0
    blended = Opacity(opaque, None if cutoff is None else cutoff * opaque, blends=True, tint=shown)
    if mode == "absent" or (mode == "cutout" and opaque < CUTOFF):
        return (blended,)
    if alpha == "BLEND" and mode == "cutout":
        return Opacity(opaque, CUTOFF, stand_in=True), blended
    if mode in ("filter", "stain", "shade"):
        # Where alpha is too low to be drawn, shadow maps have a hole: direct light passes there, as it does in frames.
        least = ALPHA_MIN if alpha == "BLEND" else cutoff
        passes = Filter(alpha == "BLEND", 1 - opaque, alpha == "BLEND" and mode == "stain")
        if mode != "shade":
            passes = replace(passes, clear=clear_below(passes, tint))
        return Opacity(1.0, least, stand_in=True, filter=passes), blended
    return Opacity(1.0, cutoff, stand_in=True), blended


def clear_below(passes: Filter, tint: float) -> float:
    """The alpha below which a surface lets through at least CLEAR, if the base colour leaves `tint` of a channel."""
    covered = passes.transmission * tint
    if covered >= CLEAR:
        return math.inf
    left_open = tint if passes.stained else 1.0
    return max((left_open - CLEAR) / (left_open - covered), 0.0) if passes.blends and left_open > covered else 0.0


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
