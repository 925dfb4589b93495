"""Light from outside the glTF file: where it comes from in numbers, flags and TOML alike, what is refused."""

import argparse
import shutil

import numpy as np
import pytest
import scenes
from repository import SCENES

from gsgi.baker.cli import inputs, options
from gsgi.baker.cli.console import Console
from gsgi.baker.progress import Progress
from gsgi.runtime.errors import FileError, SceneError, UsageError
from gsgi.runtime.gltf.scene_file import read_scene
from gsgi.runtime.image import write_image
from gsgi.runtime.lighting import KEYS, Lighting, beside, check, light, read_lights
from gsgi.runtime.scene import Light

R = np.sqrt(0.5)

TOML = """
env = "sky.exr"
env_rotation = 90
env_scale = 2.5
sun = [135, 30.5]
sun_irradiance = 20
sun_color = [1, 0.9, 0.8]
light_scale = 0.25
group_each = true
[groups]
lamps = ["lamp*", "ceiling"]
sky = ["environment"]
"""
FLAGS = ["--env-rotation", "90", "--env-scale", "2.5", "--sun", "135,30.5", "--sun-irradiance", "20",
         "--sun-color", "1,0.9,0.8", "--light-scale", "0.25", "--group-each", "--group", "lamps=lamp*",
         "--group", "sky=environment", "--group", "lamps=ceiling"]  # fmt: skip


def lamp() -> Light:
    return Light("point", np.array([4.0, 2.0, 1.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))


def parse(*flags: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    options.add_scene(parser)
    options.add_light(parser)
    options.add_groups(parser)
    return parser.parse_args([*map(str, flags)])


def lighting_of(*flags: str) -> Lighting:
    return inputs._lighting(parse(*flags), Progress())


@pytest.mark.parametrize(
    ("azimuth", "elevation", "towards"),
    [
        (0, 0, (0, 0, -1)),  # north
        (90, 0, (1, 0, 0)),  # east
        (180, 0, (0, 0, 1)),
        (270, 0, (-1, 0, 0)),
        (-90, 0, (-1, 0, 0)),
        (0, 90, (0, 1, 0)),
        (123, 90, (0, 1, 0)),
        (45, 0, (R, 0, -R)),
        (90, 45, (R, R, 0)),
        (0, 30, (0, 0.5, -np.sqrt(0.75))),
        (225, 45, (-0.5, R, 0.5)),
        (0, -30, (0, -0.5, -np.sqrt(0.75))),
    ],
)
def test_the_sun_stands_where_it_is_put(azimuth, elevation, towards):
    scene = light(scenes.furnace(), Lighting(sun=(azimuth, elevation), sun_irradiance=8, sun_color=(1, 0.5, 0.25)))
    (sun,) = scene.lights
    assert sun.kind == "directional"
    np.testing.assert_allclose(sun.direction, -np.array(towards), atol=1e-12)
    np.testing.assert_allclose(sun.color, [8, 4, 2])
    assert sun.range == np.inf


def test_the_sun_joins_the_lights_of_the_file():
    scene = light(scenes.lit_floor(lamp()), Lighting(sun=(0, 45)))
    assert [one.kind for one in scene.lights] == ["point", "directional"]
    np.testing.assert_array_equal(scene.lights[1].color, [10, 10, 10])


def test_one_colour_all_around():
    environment = light(scenes.furnace(), Lighting(env=(1, 2, 3), env_scale=2)).environment
    assert environment.radiance.dtype == np.float32
    np.testing.assert_array_equal(environment.radiance, [[[2, 4, 6]]])
    assert environment.rotation == 0


def test_an_image_is_turned_and_scaled(tmp_path):
    image = np.random.default_rng(0).random((2, 4, 3)).astype(np.float32)
    write_image(tmp_path / "sky.exr", image)
    lighting = Lighting(env=str(tmp_path / "sky.exr"), env_rotation=90, env_scale=0.5)
    environment = light(scenes.furnace(), lighting).environment
    np.testing.assert_allclose(environment.radiance, image / 2)
    assert environment.rotation == pytest.approx(np.pi / 2)


def test_a_scale_reaches_every_light_of_the_file_and_no_other():
    lit = scenes.lit_floor(lamp())
    np.testing.assert_allclose(light(lit, Lighting(light_scale=0.5)).lights[0].color, [2, 1, 0.5])
    furnace = light(scenes.furnace(emission=3.0), Lighting(light_scale=0.5, sun=(0, 45), env=(1, 1, 1)))
    assert furnace.materials[0].emission == (1.5, 1.5, 1.5)
    np.testing.assert_array_equal(furnace.lights[0].color, [10, 10, 10])
    np.testing.assert_array_equal(furnace.environment.radiance, [[[1, 1, 1]]])
    off = light(lit, Lighting(light_scale=0, sun=(0, 45)))
    assert [one.name for one in off.lights] == ["sun"]


def test_without_arguments_the_scene_is_as_it_was():
    scene = scenes.lit_floor(lamp())
    assert light(scene, Lighting()) is scene


def test_toml_and_flags_say_the_same(tmp_path):
    (tmp_path / "room.lights.toml").write_text(TOML)
    from_toml = lighting_of(tmp_path / "room.gltf")
    from_flags = lighting_of("nowhere/room.gltf", *FLAGS, "--env", tmp_path / "sky.exr")
    assert from_toml == from_flags
    assert from_toml.env == str(tmp_path / "sky.exr")
    assert all(getattr(from_toml, key) != getattr(Lighting(), key) for key in KEYS)  # none was left out
    assert lighting_of("nowhere/room.gltf", "--lights", tmp_path / "room.lights.toml") == from_flags


def test_flags_win_key_by_key(tmp_path):
    (tmp_path / "room.lights.toml").write_text(TOML)
    lighting = lighting_of(tmp_path / "room.glb", "--sun", "10,20", "--env", "1,2,3", "--light-scale", "0")
    assert lighting.sun == (10, 20)
    assert lighting.env == (1, 2, 3)
    assert lighting.light_scale == 0
    assert lighting.sun_irradiance == 20
    assert lighting.env_rotation == 90


def test_the_file_beside_the_scene_is_found_and_told(tmp_path, capsys):
    assert beside(tmp_path / "room.gltf") is None
    (tmp_path / "room.lights.toml").write_text("light_scale = 2")
    assert beside(tmp_path / "room.gltf") == beside(tmp_path / "room.glb") == tmp_path / "room.lights.toml"
    inputs._lighting(parse(tmp_path / "room.gltf"), Progress(Console()))
    assert "room.lights.toml" in capsys.readouterr().err
    assert lighting_of(tmp_path / "hall.gltf") == Lighting()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sun = [1, 2", "expected TOML, got an error: "),
        ('name = "x"', "name: expected one of the keys env, env_rotation, "),
        (
            "[sun]\nazimuth = 1",
            "sun: expected env, or azimuth and elevation in degrees from -3600 to 3600, got {'azimuth': 1}",
        ),
        ("sun = [1]", "sun: expected env, or azimuth and elevation in degrees from -3600 to 3600, got 1"),
        ("sun = [1, 91]", "sun: expected an elevation from -90 to 90 degrees, got 91"),
        ("sun = [1, nan]", "sun: expected env, or azimuth and elevation"),
        ("env = 1", "env: expected a file or three numbers from 0 to 1e+15, got 1"),
        ('env = ""', "env: expected a file or three numbers from 0 to 1e+15, got ''"),
        ("env = [1, 2, -3]", "env: expected a file or three numbers from 0 to 1e+15, got [1, 2, -3]"),
        ('env = "../sky.exr"', "env: expected a path inside the folder of this file, got '../sky.exr'"),
        ('env = "/sky.exr"', "env: expected a path inside the folder of this file, got '/sky.exr'"),
        ("env_scale = -1", "env_scale: expected a number from 0 to 1e+15, got -1"),
        ("light_scale = true", "light_scale: expected a number from 0 to 1e+15, got True"),
        ('light_scale = "much"', "light_scale: expected a number from 0 to 1e+15, got 'much'"),
        ("light_scale = inf", "light_scale: expected a number from 0 to 1e+15, got inf"),
        ("sun_color = [1, 1]", "sun_color: expected three numbers from 0 to 1e+15, got [1, 1]"),
    ],
)
def test_a_wrong_file_is_refused_with_file_and_key(tmp_path, text, message):
    path = tmp_path / "room.lights.toml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        read_lights(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_text_or_absent_is_refused(tmp_path):
    path = tmp_path / "x.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(SceneError, match="expected TOML"):
        read_lights(path)
    with pytest.raises(FileError, match=r"nowhere.toml: cannot read"):
        read_lights(tmp_path / "nowhere.toml")
    path.write_bytes(b"#" * (2 << 20))
    with pytest.raises(SceneError, match="at most"):
        read_lights(path)


@pytest.mark.parametrize("flags", [["--sun", "1"], ["--sun", "a,b"], ["--env", "1,2"], ["--env-scale", "-1"],
                                   ["--sun-color", "1,1,x"], ["--light-scale", "nan"], ["--env", ""]])  # fmt: skip
def test_a_wrong_flag_is_refused(flags):
    with pytest.raises(argparse.ArgumentError, match="expected"):
        parse("room.gltf", *flags)


def test_part_of_a_light_alone_is_refused(tmp_path):
    for flags, name in ((["--sun-irradiance", "3"], "sun"), (["--env-scale", "3"], "env")):
        with pytest.raises(UsageError, match=f"given without --{name}"):
            lighting_of("room.gltf", *flags)
    (tmp_path / "room.lights.toml").write_text("sun_irradiance = 3")
    with pytest.raises(SceneError, match=r"room\.lights\.toml: sun_irradiance is given without sun"):
        lighting_of(tmp_path / "room.gltf")
    assert lighting_of(tmp_path / "room.gltf", "--sun", "0,45").sun_irradiance == 3


def test_unknown_keys_are_ours_to_name():
    with pytest.raises(ValueError, match="light_scale"):
        check("lightscale", 1)


def test_lighting_from_python_is_checked_as_flags_are(tmp_path):
    for wrong in (
        {"env": (-1, 0, 0)}, {"env": (1, 1)}, {"env": ""}, {"light_scale": -1.0}, {"light_scale": float("nan")},
        {"sun_irradiance": -5}, {"sun": "140,35"}, {"sun": (1, 2, 3)}, {"groups": {"lamps": "lamp*"}},
    ):  # fmt: skip
        (key,) = wrong
        with pytest.raises(UsageError, match=f"lighting: {key}: "):
            Lighting(**wrong)
    for key in ("light_scale", "sun_color", "groups"):
        with pytest.raises(UsageError, match=f"lighting: {key}: expected"):
            Lighting(**{key: None})
    assert Lighting(light_scale=np.array(2.0), group_each=np.True_) == Lighting(light_scale=2.0, group_each=True)
    assert Lighting(env=tmp_path / "sky.hdr").env == str(tmp_path / "sky.hdr")
    assert Lighting(env=np.float32([1, 2, 3]), sun=(np.int64(90), 30)) == Lighting(env=(1, 2, 3), sun=(90.0, 30.0))


def test_a_sun_of_no_image_is_said_with_the_flag_or_the_file(tmp_path):
    room = shutil.copy(SCENES / "cornell.glb", tmp_path / "room.glb")
    with pytest.raises(UsageError, match="--sun: env: expected an environment image"):
        inputs.read_scene(parse(room, "--sun", "env"), Progress())
    (tmp_path / "room.lights.toml").write_text('sun = "env"')
    for read in (lambda path: inputs.read_scene(parse(path), Progress()), read_scene):
        with pytest.raises(SceneError, match=r"room\.lights\.toml: sun: env: expected an environment image"):
            read(room)
