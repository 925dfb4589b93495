"""Light that a glTF file does not define: an environment, a sun, a factor on the file's own lights."""

import dataclasses
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path

import numpy as np

from .environment import read_environment
from .environment_sun import find_sun
from .errors import FileError, SceneError, UsageError
from .files import inside
from .light_groups import with_each
from .scene import MAX_LIGHT, Environment, Light, Scene

SUFFIX = ".lights.toml"  # room.lights.toml belongs to room.gltf or room.glb
MAX_TOML_BYTES = 1 << 20
DEGREES_MAX = 3600.0
SUN_IRRADIANCE = 10.0  # about three times the irradiance of a sky of radiance 1
OF_ENVIRONMENT = "env"  # instead of the angles of a sun: that of the environment image


@dataclass(frozen=True)
class Lighting:
    """Changes to a scene's light, with the names of the flags and TOML keys; the defaults change nothing.

    Raises UsageError for a value that its key cannot have.

    env: an image file, or one radiance (3,) for all directions. It is rotated by env_rotation (degrees,
    counter-clockwise seen from above) and multiplied by env_scale. sun: azimuth (degrees, clockwise from north seen
    from above; north is -Z, east is +X) and elevation (degrees above the horizon), or "env": that of the image, which
    is taken out of it. A surface that faces the sun receives sun_irradiance * sun_color (lx, the unit of the file's
    directional lights; by default SUN_IRRADIANCE), or what it has of the image's sun, times sun_color. light_scale
    multiplies the lights of the glTF file, both punctual lights and emissive surfaces; 0 turns them off. groups: lights
    to be baked apart, as patterns of the names of punctual lights, of their nodes, and of emissive materials, and the
    words "sun" and "environment", by the name of the group. group_each: every other light is a group of its own.
    """

    env: str | tuple[float, float, float] | None = None
    env_rotation: float = 0.0
    env_scale: float = 1.0
    sun: tuple[float, float] | str | None = None
    sun_irradiance: float | None = None
    sun_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    light_scale: float = 1.0
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    group_each: bool = False

    def __post_init__(self):
        for key in KEYS:
            value = getattr(self, key)
            if value is not None or key not in OPTIONAL:
                try:
                    object.__setattr__(self, key, check(key, value))
                except ValueError as error:
                    raise UsageError(f"lighting: {key}: {error}") from None


OPTIONAL = "env", "sun", "sun_irradiance"  # may be None
KEYS = tuple(field.name for field in dataclasses.fields(Lighting))


def light(scene: Scene, lighting: Lighting) -> Scene:
    """The scene with this lighting.

    Raises FileError or SceneError for an environment image that cannot be used, or has no sun that was asked for,
    UsageError for a sun that is asked of no image, and SceneError for a light that cannot be a group of its own.
    """
    if found := contradiction(lighting):
        raise UsageError("".join(found))
    if lighting.light_scale != 1:
        scene = _scaled(scene, lighting.light_scale)
    if lighting.env is not None:
        files = (Path(lighting.env),) if isinstance(lighting.env, str) else ()
        scene = dataclasses.replace(scene, environment=_environment(lighting), files=(*scene.files, *files))
    if lighting.sun == OF_ENVIRONMENT:
        scene = _with_sun_of_environment(scene, lighting)
    elif lighting.sun is not None:
        scene = dataclasses.replace(scene, lights=(*scene.lights, _sun(lighting)))
    if lighting.groups or lighting.group_each:
        groups = {name: tuple(patterns) for name, patterns in lighting.groups.items()}
        scene = dataclasses.replace(scene, groups=with_each(scene, groups) if lighting.group_each else groups)
    return scene


def contradiction(lighting: Lighting) -> tuple[str, str] | None:
    """The key whose value others contradict, and how, as text that follows it; None if they agree."""
    if lighting.sun != OF_ENVIRONMENT:
        return None
    if not isinstance(lighting.env, str):
        return "sun", f": {OF_ENVIRONMENT}: expected an environment image as env, got {lighting.env or 'none'}"
    if lighting.sun_irradiance is not None:
        return "sun_irradiance", f": the sun of {lighting.env} has its own; sun_color scales it"
    return None


def beside(scene: str | Path) -> Path | None:
    """The TOML file that belongs to a scene file, or None."""
    path = Path(scene).with_suffix(SUFFIX)
    return path if path.is_file() else None


def read_lights(path: str | Path) -> dict:
    """The arguments of `Lighting` that a TOML file sets. Raises FileError, and SceneError with file and key.

    The path of an environment image is relative to the folder of the file and must lie inside it.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_TOML_BYTES + 1)
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    if len(data) > MAX_TOML_BYTES:
        raise SceneError(f"{path}: expected at most {MAX_TOML_BYTES} bytes, got more")
    try:
        table = tomllib.loads(data.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SceneError(f"{path}: expected TOML, got an error: {error}") from None
    values = {}
    for key, value in table.items():
        try:
            values[key] = check(key, value)
        except ValueError as error:
            raise SceneError(f"{path}: {key}: {error}") from None
    if isinstance(values.get("env"), str):
        values["env"] = _inside(Path(path), values["env"])
    return values


def check(key: str, value):
    """A value for `key` of `Lighting`, with numbers as floats. Raises ValueError with the expected and given value."""
    match key:
        case "env":
            if isinstance(value, str | os.PathLike) and os.fspath(value):
                return os.fspath(value)
            return _numbers(value, 3, "a file or three numbers")
        case "sun":
            return value if isinstance(value, str) and value == OF_ENVIRONMENT else _angles(value)
        case "sun_color":
            return _numbers(value, 3, "three numbers")
        case "env_rotation":
            return _numbers(value, 1, "degrees", -DEGREES_MAX, DEGREES_MAX)[0]
        case "env_scale" | "sun_irradiance" | "light_scale":
            return _numbers(value, 1, "a number")[0]
        case "groups":
            return _groups(value)
        case "group_each":
            if not isinstance(value, bool | np.bool_):
                raise ValueError(f"expected true or false, got {value!r}")
            return bool(value)
    raise ValueError(f"expected one of the keys {', '.join(KEYS)}")


def _groups(value) -> dict[str, tuple[str, ...]]:
    if not isinstance(value, Mapping):
        raise ValueError(f"expected a table of lists of patterns, got {value!r}")
    for name, patterns in value.items():
        if not isinstance(patterns, list | tuple) or not all(isinstance(pattern, str) for pattern in patterns):
            raise ValueError(f"{name}: expected a list of patterns, got {patterns!r}")
    return {name: tuple(patterns) for name, patterns in value.items()}


def _angles(value) -> tuple[float, float]:
    what = f"{OF_ENVIRONMENT}, or azimuth and elevation in degrees"
    azimuth, elevation = _numbers(value, 2, what, -DEGREES_MAX, DEGREES_MAX)
    if abs(elevation) > 90:
        raise ValueError(f"expected an elevation from -90 to 90 degrees, got {elevation:g}")
    return azimuth, elevation


def _numbers(value, count: int, what: str, low: float = 0.0, high: float = MAX_LIGHT) -> tuple[float, ...]:
    value = np.atleast_1d(value).tolist() if isinstance(value, np.ndarray) else value
    items = value if isinstance(value, list | tuple) else [value]
    numbers = [float(item) for item in items if isinstance(item, Real) and not isinstance(item, bool)]
    if not len(numbers) == len(items) == count or not all(low <= number <= high for number in numbers):
        shown = items[0] if len(items) == 1 else list(items)
        raise ValueError(f"expected {what} from {low:g} to {high:g}, got {shown!r}")
    return tuple(numbers)


def _inside(toml: Path, name: str) -> str:
    """The path of an image that a TOML file names. The file is untrusted, so the path must not leave its folder."""
    try:
        path = inside(toml.parent.resolve(), name)
    except (ValueError, OSError, RuntimeError):  # a NUL, a loop of symbolic links
        path = None
    if path is None:
        raise SceneError(f"{toml}: env: expected a path inside the folder of this file, got {name!r}")
    return str(toml.parent / name)


def _scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all lights of the glTF file multiplied by `factor`."""
    lights = [dataclasses.replace(one, color=one.color * factor) for one in scene.lights if factor]
    materials = [
        dataclasses.replace(material, emission=tuple(factor * value for value in material.emission))
        for material in scene.materials
    ]
    return dataclasses.replace(scene, lights=tuple(lights), materials=tuple(materials))


def _environment(lighting: Lighting) -> Environment:
    if isinstance(lighting.env, str):
        radiance = read_environment(lighting.env)
    else:
        radiance = np.array(lighting.env, np.float32).reshape(1, 1, 3)
    radiance = (radiance * lighting.env_scale).astype(np.float32)
    if radiance.max() > MAX_LIGHT:
        raise SceneError(f"{lighting.env}: expected radiance up to {MAX_LIGHT:g}, got {radiance.max():g}")
    return Environment(radiance, float(np.radians(lighting.env_rotation)))


def _sun(lighting: Lighting) -> Light:
    azimuth, elevation = np.radians(lighting.sun)
    towards = [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)]
    irradiance = SUN_IRRADIANCE if lighting.sun_irradiance is None else lighting.sun_irradiance
    return _sunlight(np.array(towards), irradiance * np.array(lighting.sun_color))


def _sunlight(towards: np.ndarray, irradiance: np.ndarray) -> Light:
    return Light("directional", irradiance, position=np.zeros(3), direction=-towards, name="sun")


def _with_sun_of_environment(scene: Scene, lighting: Lighting) -> Scene:
    environment = scene.environment
    sun = find_sun(environment.radiance)
    if sun is None:
        raise SceneError(f"{lighting.env}: expected an image with a sun for `sun` = {OF_ENVIRONMENT}, got none")
    (x, y, z), (cos, sin) = sun.towards, (np.cos(environment.rotation), np.sin(environment.rotation))
    light = _sunlight(np.array([cos * x + sin * z, y, cos * z - sin * x]), sun.irradiance * lighting.sun_color)
    rest = dataclasses.replace(environment, radiance=sun.rest)
    return dataclasses.replace(scene, environment=rest, lights=(*scene.lights, light))
