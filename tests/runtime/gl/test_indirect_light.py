"""The light pass in hosts that know nothing of our renderer: their textures, matrices, targets and GL state."""

import itertools

import moderngl
import numpy as np
import pytest
from host import CAMERA, SIZE, Host, bake, drawn, pixels, projection, projection_for, rg16, texture

from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.host_textures import ALBEDOS, DEPTHS, NORMALS, SPACES, Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight


@pytest.fixture
def host(gl):
    return Host(gl)


@pytest.fixture
def light(gl):
    made = IndirectLight(gl, bake(), splat_scale=1)
    yield made
    made.release()


@pytest.mark.parametrize(("depth", "normal", "space"), list(itertools.product(DEPTHS, NORMALS, SPACES)))
def test_every_encoding_gives_the_same_light(gl, host, depth, normal, space):
    """In every pixel, to one step of the halves in which B is stored.

    Depth in 0 ... 1 is rounded to 2^-24, which is 5e-6 m on the farthest wall: far less than such a step of light.
    """
    light = IndirectLight(gl, bake(), Encoding(depth, normal, space), splat_scale=1)
    assert host.indirect.mean() > 0.2
    assert host.indirect.max() < 1
    assert np.abs(drawn(light, gl, host) - host.indirect).max() <= 2**-11
    light.release()


def test_octahedral_normals_in_a_texture_of_16_bits(gl, host):
    encoding = Encoding("window", "octahedral unsigned")
    light = IndirectLight(gl, bake(), encoding, splat_scale=1)
    textures = host.textures(gl, encoding)[0], rg16(gl, host.normal)
    found = pixels(light.draw(*textures, CAMERA.view_from_world, projection_for(encoding)))[..., :3]
    assert np.abs(found - host.indirect).max() <= 2**-10
    light.release()


@pytest.mark.parametrize("splat_scale", [1, 2, 4])  # whose blocks the part begins between
def test_a_part_of_the_image_is_a_camera_of_its_own(gl, host, splat_scale):
    """Split screen, tiles, stereo: an off-axis frustum and a viewport, and the whole again after it."""
    light = IndirectLight(gl, bake(), splat_scale=splat_scale)
    whole = drawn(light, gl, host)
    part = drawn(light, gl, host, viewport=(16, 8, 48, 40))
    assert part.shape == (40, 48, 3)
    np.testing.assert_allclose(part[4:-4, 4:-4], whole[8:48, 16:64][4:-4, 4:-4], atol=2e-3)
    np.testing.assert_array_equal(drawn(light, gl, host), whole)
    light.release()


@pytest.mark.parametrize("box", [None, ((-1.0, -1, -1), (0.2, 1, 1))])
def test_another_scale_reads_the_light_that_is_uploaded(gl, host, box):
    light = IndirectLight(gl, bake(), splat_scale=1, box=box)
    for scale in (4, 2, 1):
        fresh = IndirectLight(gl, bake(), splat_scale=scale, box=box)
        textures = light._splats._part.textures
        light.set_splat_scale(scale)
        np.testing.assert_array_equal(drawn(light, gl, host), drawn(fresh, gl, host))
        assert light._splats._part.textures is textures
        fresh.release()
    with pytest.raises(ValueError, match="splat_scale: 5 is none of 1, 2, 3, 4"):
        light.set_splat_scale(5)
    light.release()


@pytest.mark.parametrize("albedo", ALBEDOS)
def test_light_is_added_within_the_viewport_alone(gl, host, albedo):
    encoding = Encoding(albedo=albedo)
    light = IndirectLight(gl, bake(), encoding, splat_scale=1)
    part = drawn(light, gl, host, viewport=(16, 8, 48, 40))
    stored = np.random.default_rng(0).uniform(0, 1, (SIZE[1], SIZE[0], 4))
    stored[0, 0] = np.nan
    reflectance = stored if albedo == "linear" else np.where(
        stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4
    )  # fmt: skip
    before = np.random.default_rng(1).uniform(0, 1, stored.shape).astype(np.float32)
    target = gl.framebuffer(colour := texture(gl, before))
    light.add(target, texture(gl, stored))
    expected = before.copy()
    expected[8:48, 16:64, :3] += reflectance[8:48, 16:64, :3] * part
    np.testing.assert_allclose(pixels(colour), expected, rtol=1e-4, atol=1e-5)
    light.release()


def test_a_broken_albedo_adds_nothing(gl, host, light):
    drawn(light, gl, host)
    target = gl.framebuffer(colour := texture(gl, np.ones((SIZE[1], SIZE[0], 4))))
    light.add(target, texture(gl, np.full((SIZE[1], SIZE[0], 4), np.nan)))
    np.testing.assert_array_equal(pixels(colour), 1)


def test_files_of_one_room_each_light_their_rooms(gl, host):
    """Two halves of the room, each lit by a file of its own, next to each other in one target."""
    walls = np.array([[-9, -9, -9], [0, 9, 9]]), np.array([[0, -9, -9], [9, 9, 9]])
    rooms = [IndirectLight(gl, bake(seed), splat_scale=1, box=tuple(box)) for seed, box in enumerate(walls)]
    whole = [IndirectLight(gl, bake(seed), splat_scale=1) for seed in range(2)]
    target = gl.framebuffer(colour := texture(gl, np.zeros((SIZE[1], SIZE[0], 4))))
    white = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))
    for room in rooms:
        drawn(room, gl, host)
        room.add(target, white)
    left, right = (drawn(light, gl, host) for light in whole)
    x = world_x(host.depth)
    clear = np.abs(x) > 1e-3
    expected = np.where(x[..., None] < 0, left, right)
    assert 0.2 < (x < 0).mean() < 0.8
    np.testing.assert_array_equal(pixels(colour)[..., :3][clear], expected[clear])
    for light in rooms + whole:
        light.release()


def world_x(depth: np.ndarray) -> np.ndarray:
    """Of the points in the pixels of an image, row 0 below."""
    p = CAMERA.pinhole(*SIZE)
    column, row = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    view = np.stack([(column - p.cx) / p.fx, (row - p.cy) / p.fy, -np.ones_like(row)], axis=-1) * depth[..., None]
    return (view @ CAMERA.world_from_view[:3, :3].T + CAMERA.position)[..., 0]


def test_far_from_the_origin_the_light_is_the_same(gl, host):
    """1e5 m away: floats of the file have 8 mm there, so it is a file made for that place that is compared."""
    offset = np.float32([65536, -131072, 65536])
    near, far = (IndirectLight(gl, Bake(b.gaussians, b.blend, coarse=b.coarse), splat_scale=1)
                 for b in (bake(), bake(offset=offset)))  # fmt: skip
    for b in (near, far):
        assert b._origin.any() == (b is far)
    pose = CAMERA.world_from_view.copy()
    pose[:3, 3] += offset
    textures = host.textures(gl, near.encoding)
    seen = [
        pixels(light.draw(*textures, np.linalg.inv(world), projection()))[..., :3]
        for light, world in ((near, CAMERA.world_from_view), (far, pose))
    ]
    # Centres are rounded by 8 mm, a twentieth of the Gaussians' size.
    assert np.abs(seen[0] - seen[1]).mean() < 0.05 * seen[0].mean()
    near.release()
    far.release()


def test_a_host_keeps_what_it_made(gl, host, light):
    textures = host.textures(gl, light.encoding)
    made = IndirectLight(gl, bake(), splat_scale=2)
    made.draw(*textures, CAMERA.view_from_world, projection())
    made.release()
    again = pixels(light.draw(*textures, CAMERA.view_from_world, projection()))
    np.testing.assert_array_equal(again[..., :3], host.indirect.astype(np.float16))


@pytest.mark.parametrize("field", ["depth", "normal", "normal_space", "albedo"])
def test_an_unknown_encoding_is_named(gl, field):
    with pytest.raises(ValueError, match=f"^{field}: 'other' is none of "):
        IndirectLight(gl, bake(), Encoding(**{field: "other"}))


@pytest.mark.parametrize(
    ("name", "view", "clip"),
    [
        ("view_from_world", np.diag([2.0, 2, 2, 1]), projection()),
        ("view_from_world", np.full((4, 4), np.nan), projection()),
        ("clip_from_view", np.eye(4), np.ones((4, 4))),
        ("clip_from_view", np.eye(4), np.diag([1.0, 1, 0, 1])),
        ("clip_from_view", np.eye(4), projection() * np.nan),
        ("clip_from_view", np.eye(4), np.eye(3)),
        ("clip_from_view", np.eye(4), projection() * [0, 1, 1, 1]),
        ("clip_from_view", np.eye(4), projection() + np.eye(4)[[1, 0, 2, 3]]),
        ("clip_from_view", np.eye(4), projection() + 0.1 * np.eye(4)[[2, 1, 0, 3]]),
    ],
)
def test_matrices_that_are_no_camera_are_named(gl, host, light, name, view, clip):
    with pytest.raises(ValueError, match=name):
        light.draw(*host.textures(gl, light.encoding), view, clip)


def test_a_context_that_a_window_made_will_do(gl, host):
    """moderngl attached to a current context, as in a host's window, finds OpenGL's functions in another way."""
    create_context().release()  # glXGetCurrentContext finds a context of EGL only after it has been switched
    gl.__enter__()
    attached = moderngl.create_context()
    light = IndirectLight(attached, bake(), splat_scale=1)
    textures = host.textures(attached, light.encoding)
    drawn = pixels(light.draw(*textures, CAMERA.view_from_world, projection()))
    np.testing.assert_array_equal(drawn[..., :3], host.indirect.astype(np.float16))
    light.release()
