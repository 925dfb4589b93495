"""How the textures of a host's G-buffer are encoded."""

from typing import NamedTuple

DEPTHS = {"linear": "", "window": "DEPTH_WINDOW", "reversed": "DEPTH_REVERSED"}
NORMALS = {"octahedral": "NORMAL_OCTAHEDRAL", "signed": "", "unsigned": "NORMAL_UNSIGNED"}
SPACES = {"world": "", "view": "NORMAL_VIEW_SPACE"}
ALBEDOS = {"linear": "", "srgb": "ALBEDO_SRGB"}


class Encoding(NamedTuple):
    """Each a key of the tables above.

    depth: in the red channel, "linear": m along the view axis, 0 = no surface; "window": an OpenGL depth buffer, 1 = no
    surface; "reversed": the depth buffer of a reversed projection (0 <= z <= w), 0 = no surface.
    normal: "octahedral" in xy; "signed": xyz; "unsigned": xyz from -1..1 to 0..1. Towards the camera, before any normal
    map, which B does not know; any length. normal_space: "world" or "view".
    albedo: the diffuse part of the reflectance, "linear" or "srgb": encoded in a texture whose format does not say so.
    """

    depth: str = "linear"
    normal: str = "octahedral"
    normal_space: str = "world"
    albedo: str = "linear"

    def defines(self) -> dict[str, bool]:
        """Of the shaders that include glsl/host.glsl. Raises ValueError that names field and choices."""
        chosen = {
            _chosen("depth", self.depth, DEPTHS),
            _chosen("normal", self.normal, NORMALS),
            _chosen("normal_space", self.normal_space, SPACES),
        }
        names = *DEPTHS.values(), *NORMALS.values(), *SPACES.values()
        return {name: name in chosen for name in names if name}

    def albedo_defines(self) -> dict[str, bool]:
        """Of glsl/add_light.frag. Raises ValueError as defines() does."""
        return {"ALBEDO_SRGB": bool(_chosen("albedo", self.albedo, ALBEDOS))}


OURS = Encoding()  # of GBuffer


def _chosen(field: str, value: str, choices: dict[str, str]) -> str:
    if value not in choices:
        raise ValueError(f"{field}: {value!r} is none of {', '.join(choices)}")
    return choices[value]
