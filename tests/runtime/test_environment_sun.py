"""The sun of an environment image: where it is, what it has of the light, and that no light is lost or made."""

import numpy as np
import pytest
import scenes

from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.runtime.environment_sun import SHARE_LEAST, find_sun
from gsgi.runtime.errors import SceneError, UsageError
from gsgi.runtime.image import write_image
from gsgi.runtime.lighting import Lighting, light
from gsgi.runtime.scene import Scene

SKY, SUN = np.float32([0.5, 0.75, 1.0]), np.float32([3000.0, 2500.0, 2000.0])


def sky(row: int = 20, column: int = 100, sun=SUN, height: int = 128) -> np.ndarray:
    """A sky twice as bright at the top as below, with a sun of 2 x 2 texels."""
    fall = np.linspace(2, 1, height, dtype=np.float32)[:, None, None]
    image = np.ascontiguousarray(np.broadcast_to(SKY * fall, (height, 2 * height, 3)))
    image[row : row + 2, column : column + 2] = sun
    return image


def towards(row: float, column: float, height: int = 128) -> np.ndarray:
    polar, azimuth = row / height * np.pi, (column / height - 1) * np.pi
    return np.array([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)])


@pytest.mark.parametrize(("row", "column"), [(20, 100), (60, 254), (12, 7)])
def test_it_is_found_and_taken_out(row, column):
    image = sky(row, column)
    sun = find_sun(image)
    assert np.linalg.norm(sun.towards - towards(row + 1, column + 1)) < 0.01
    assert 0.1 < sun.share < 1
    rest = find_sun(sun.rest)
    assert rest is None
    texels = (image != sun.rest).any(axis=2)
    assert texels.sum() == 4
    np.testing.assert_allclose(sun.rest[texels][0], sun.rest[row + 3, column], rtol=0.1)
    np.testing.assert_allclose(sun.irradiance / sun.irradiance[0], SUN / SUN[0], rtol=0.01)


def test_small_images_have_suns_too():
    assert find_sun(sky(2, 9, height=8)) is not None


@pytest.mark.parametrize("image", [
    sky(sun=SKY), sky(sun=0.05 * SHARE_LEAST * SUN), np.zeros((8, 16, 3), np.float32), np.ones((1, 1, 3), np.float32),
    np.random.default_rng(0).random((64, 128, 3), np.float32),
])  # fmt: skip
def test_what_is_no_sun_is_left(image):
    assert find_sun(image) is None


def test_light_is_neither_lost_nor_made(tmp_path):
    """A floor under the open sky, which is turned: what the sun loses of B it gives as direct light."""
    path = str(tmp_path / "sky.exr")
    write_image(path, sky())
    floor, up, sampling = Scene((scenes.floor(),), (scenes.WHITE,)), np.float32([[0, 1, 0]]), Sampling(1 << 14)
    found = []
    for sun in (None, "env"):
        lit = light(floor, Lighting(env=path, env_rotation=70, env_scale=0.5, sun=sun, sun_color=(1, 1, 1)))
        tracer = Tracer(lit)
        found.append((tracer.indirect(0 * up, up, up, sampling, 0).mean + tracer.direct(0 * up, up, up))[0])
        wall = np.float32([[0.6, 0, 0.8]])
        found[-1] = np.concatenate([
            found[-1], (tracer.indirect(0 * up, wall, wall, sampling, 0).mean + tracer.direct(0 * up, wall, wall))[0]
        ])  # fmt: skip
    np.testing.assert_allclose(found[1], found[0], rtol=0.01)
    (only,) = lit.lights
    assert only.name == "sun"
    assert tracer.direct(0 * up, up, up).min() > 0.2 * found[0].min()


def test_where_there_is_none_one_line_says_so(tmp_path):
    path = str(tmp_path / "overcast.exr")
    write_image(path, sky(sun=SKY))
    scene = scenes.furnace()
    with pytest.raises(SceneError, match=r"overcast.exr: expected an image with a sun .* got none"):
        light(scene, Lighting(env=path, sun="env"))
    for env in (None, (1, 1, 1)):
        with pytest.raises(UsageError, match="expected an environment image"):
            light(scene, Lighting(env=env, sun="env"))
    write_image(path, sky())
    for irradiance in (3, 10):
        with pytest.raises(UsageError, match="sun_irradiance"):
            light(scene, Lighting(env=path, sun="env", sun_irradiance=irradiance))
