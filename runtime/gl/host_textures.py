"""Encodings of the textures in a host's G-buffer."""

from typing import NamedTuple

DEPTHS = {"linear": "", "window": "DEPTH_BUFFER", "zero to one": "DEPTH_BUFFER", "reversed": "DEPTH_BUFFER"}
NORMALS = {
    "octahedral": "NORMAL_OCTAHEDRAL", "octahedral unsigned": "NORMAL_OCTAHEDRAL_UNSIGNED", "signed": "",
    "unsigned": "NORMAL_UNSIGNED",
}  # fmt: skip
SPACES = {"world": "", "view": "NORMAL_VIEW_SPACE"}
ALBEDOS = {"linear": "", "srgb": "ALBEDO_SRGB"}


class Encoding(NamedTuple):
    """How a host's textures are encoded. Each field is a key of a table above.

    depth: in the red channel. "linear": m along the view axis, 0 = no surface; "window": an OpenGL depth buffer, 1 = no
    surface, for 0 <= z <= w where glClipControl says so; "zero to one": one for 0 <= z <= w, whatever it says;
    "reversed": the depth buffer of a reversed projection (0 <= z <= w), 0 = no surface.
    normal: "octahedral" in xy; "octahedral unsigned": the same, mapped from -1..1 to 0..1; "signed": xyz; "unsigned":
    xyz, mapped from -1..1 to 0..1. It points towards the camera, may have any length, and is the normal before any
    normal map: what the map makes of it is a texture of its own, `mapped`.
    normal_space: "world" or "view".
    albedo: the diffuse part of the reflectance, "linear" or "srgb". "srgb" means sRGB values in a texture whose format
    does not say so.
    depth_range: arguments of the glDepthRange under which a depth buffer was drawn. What lies outside shows no surface.
    """

    depth: str = "linear"
    normal: str = "octahedral"
    normal_space: str = "world"
    albedo: str = "linear"
    depth_range: tuple[float, float] = (0.0, 1.0)

    def defines(self) -> dict[str, bool]:
        """Defines of shaders that include glsl/surface/host.glsl. Raises ValueError that names field and choices."""
        chosen = {
            _chosen("depth", self.depth, DEPTHS),
            _chosen("normal", self.normal, NORMALS),
            _chosen("normal_space", self.normal_space, SPACES),
        }
        names = *DEPTHS.values(), *NORMALS.values(), *SPACES.values()
        low, high = self.depth_range
        if not (0 <= low <= 1 and 0 <= high <= 1 and low != high):
            raise ValueError(f"depth_range: {self.depth_range!r} is not two different numbers from 0 to 1")
        return {name: name in chosen for name in names if name}

    def depth_uniforms(self, zero_to_one: bool, shift: float) -> dict[str, tuple[float, float]]:
        """Uniforms for `DepthCode` of glsl/surface/host.glsl.

        `zero_to_one`: whether glClipControl says so; `shift`: m, of a View.
        """
        if self.depth == "linear":
            return {"depth_ends": (0.0, 0.0), "depth_line": (1.0, shift)}
        first, last = self.depth_range
        lowest = -1.0 if self.depth == "window" and not zero_to_one else 0.0  # z / w of the clip space
        scale = (1 - lowest) / (last - first)
        ends = (last, first) if self.depth == "reversed" else (first, last)
        return {"depth_ends": ends, "depth_line": (scale, lowest - first * scale)}

    def albedo_defines(self) -> dict[str, bool]:
        """Defines of glsl/surface/add_light.frag. Raises ValueError as defines() does."""
        return {"ALBEDO_SRGB": bool(_chosen("albedo", self.albedo, ALBEDOS))}


OURS = Encoding()  # the encoding of GBuffer


def _chosen(field: str, value: str, choices: dict[str, str]) -> str:
    if value not in choices:
        raise ValueError(f"{field}: {value!r} is none of {', '.join(choices)}")
    return choices[value]
