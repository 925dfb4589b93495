"""Encodings of the textures in a host's G-buffer."""

from typing import NamedTuple

DEPTHS = {"linear": "", "window": "DEPTH_WINDOW", "reversed": "DEPTH_REVERSED"}
NORMALS = {"octahedral": "NORMAL_OCTAHEDRAL", "signed": "", "unsigned": "NORMAL_UNSIGNED"}
SPACES = {"world": "", "view": "NORMAL_VIEW_SPACE"}
ALBEDOS = {"linear": "", "srgb": "ALBEDO_SRGB"}


class Encoding(NamedTuple):
    """How a host's textures are encoded. Each field is a key of a table above.

    depth: in the red channel. "linear": m along the view axis, 0 = no surface; "window": an OpenGL depth buffer, 1 = no
    surface, for 0 <= z <= w where glClipControl says so; "reversed": the depth buffer of a reversed projection
    (0 <= z <= w), 0 = no surface.
    normal: "octahedral" in xy; "signed": xyz; "unsigned": xyz, mapped from -1..1 to 0..1. It points towards the camera,
    may have any length, and is the normal before any normal map, because B ignores normal maps.
    normal_space: "world" or "view".
    albedo: the diffuse part of the reflectance, "linear" or "srgb". "srgb" means sRGB values in a texture whose format
    does not say so.
    """

    depth: str = "linear"
    normal: str = "octahedral"
    normal_space: str = "world"
    albedo: str = "linear"

    def defines(self) -> dict[str, bool]:
        """Defines of shaders that include glsl/surface/host.glsl. Raises ValueError that names field and choices."""
        chosen = {
            _chosen("depth", self.depth, DEPTHS),
            _chosen("normal", self.normal, NORMALS),
            _chosen("normal_space", self.normal_space, SPACES),
        }
        names = *DEPTHS.values(), *NORMALS.values(), *SPACES.values()
        return {name: name in chosen for name in names if name}

    def albedo_defines(self) -> dict[str, bool]:
        """Defines of glsl/surface/add_light.frag. Raises ValueError as defines() does."""
        return {"ALBEDO_SRGB": bool(_chosen("albedo", self.albedo, ALBEDOS))}


OURS = Encoding()  # the encoding of GBuffer


def _chosen(field: str, value: str, choices: dict[str, str]) -> str:
    if value not in choices:
        raise ValueError(f"{field}: {value!r} is none of {', '.join(choices)}")
    return choices[value]
