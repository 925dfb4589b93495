"""The light pass in hosts that know nothing of our renderer: their textures, matrices, targets and GL state."""

import itertools

import moderngl
import numpy as np
import oracle
import pytest
import scenes

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend
from gsgi.runtime.gl.context import create_context
from gsgi.runtime.gl.gl_state import HostState
from gsgi.runtime.gl.host_textures import ALBEDOS, DEPTHS, NORMALS, SPACES, Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene

SIZE = 96, 64
CAMERA = scenes.inside_camera()
ROOM = Scene(tuple(scenes.box()), (scenes.WHITE,))
NEAR, FAR = 0.05, 20.0


def bake(seed=0, offset=(0.0, 0.0, 0.0)) -> Bake:
    points = Triangles(ROOM).sample(600, seed)
    light = np.random.default_rng(seed).uniform(0, 1, points.position.shape).astype(np.float32)
    fine, coarse = from_surface(points.position, points.normal, light, 0), oracle.random_gaussians(20, 2, seed=seed)
    for level in (fine, coarse):
        level.position[...] += np.float32(offset)
    return Bake(fine, SurfaceBlend(), coarse=coarse)


def projection(reversed_depth=False, size=SIZE, part=None) -> np.ndarray:
    """(4, 4) of CAMERA; `part` (x, y, width, height) px, y up: the frustum through that part of the image alone."""
    x, y, width, height = part or (0, 0, *size)
    top = NEAR * np.tan(CAMERA.yfov / 2)
    pixel = 2 * top / size[1]
    left, bottom = pixel * (x - size[0] / 2), pixel * (y - size[1] / 2)
    right, top = left + pixel * width, bottom + pixel * height
    p = np.zeros((4, 4))
    p[0, [0, 2]] = 2 * NEAR / (right - left), (right + left) / (right - left)
    p[1, [1, 2]] = 2 * NEAR / (top - bottom), (top + bottom) / (top - bottom)
    p[2, 2:] = (0, NEAR) if reversed_depth else (-(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR))
    p[3, 2] = -1
    return p


class Host:
    """What a host has drawn of ROOM at SIZE: numpy arrays, row 0 below as in GL."""

    def __init__(self, gl):
        renderer = DeferredRenderer(gl, ROOM, bake(), *SIZE)
        renderer.render(CAMERA)
        self.depth, self.normal, self.indirect = (
            np.ascontiguousarray(renderer.read(layer)[::-1]) for layer in ("depth", "normal", "indirect")
        )
        renderer.release()

    def textures(self, gl, encoding: Encoding):
        p, z = projection(encoding.depth == "reversed"), self.depth.astype(float)
        depth = {"linear": z, "window": ((-p[2, 2] * z + p[2, 3]) / z + 1) / 2, "reversed": -p[2, 2] + p[2, 3] / z}
        n = self.normal if encoding.normal_space == "world" else self.normal @ CAMERA.world_from_view[:3, :3]
        normal = {"octahedral": _octahedral(n), "signed": 2.5 * n, "unsigned": (n + 1) / 2}[encoding.normal]
        normal = np.concatenate([normal, np.full((*z.shape, 4 - normal.shape[-1]), 7)], axis=-1)
        return texture(gl, depth[encoding.depth]), texture(gl, normal)


def _octahedral(n: np.ndarray) -> np.ndarray:
    p = n[..., :2] / np.abs(n).sum(axis=-1, keepdims=True)
    folded = (1 - np.abs(p[..., ::-1])) * np.where(p >= 0, 1, -1)
    return np.where(n[..., 2:] < 0, folded, p)


def texture(gl, array: np.ndarray) -> moderngl.Texture:
    height, width, *components = array.shape
    return gl.texture((width, height), *(components or [1]), np.float32(array).tobytes(), dtype="f4")


def pixels(source: moderngl.Texture) -> np.ndarray:
    dtype = np.float16 if source.dtype == "f2" else np.float32
    return np.frombuffer(source.read(), dtype).reshape(source.height, source.width, 4).astype(np.float32)


@pytest.fixture
def host(gl):
    return Host(gl)


@pytest.fixture
def light(gl):
    made = IndirectLight(gl, bake(), splat_scale=1)
    yield made
    made.release()


def drawn(light, gl, host, **how) -> np.ndarray:
    textures = host.textures(gl, light.encoding)
    clip_from_view = projection(light.encoding.depth == "reversed", part=how.get("viewport"))
    return pixels(light.draw(*textures, CAMERA.view_from_world, clip_from_view, **how))[..., :3]


@pytest.mark.parametrize(("depth", "normal", "space"), list(itertools.product(DEPTHS, NORMALS, SPACES)))
def test_every_encoding_gives_the_same_light(gl, host, depth, normal, space):
    """As far as a depth buffer tells depth: 1 in 2^24 of 0..1, which far away is 1e-4 of the depth."""
    light = IndirectLight(gl, bake(), Encoding(depth, normal, space), splat_scale=1)
    assert host.indirect.mean() > 0.2
    difference = np.abs(drawn(light, gl, host) - host.indirect)
    assert np.quantile(difference, 0.99) < 2e-3
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


@pytest.fixture
def fresh_gl(gl):
    """A context whose state may stay as it is."""
    made = create_context()
    yield made
    made.release()
    gl.__enter__()


@pytest.mark.parametrize("kind", ["surface", "over"])
def test_the_host_finds_its_state_as_it_left_it(fresh_gl, kind):
    """Both what it set through moderngl and what it set behind moderngl's back."""
    gl, host = fresh_gl, Host(fresh_gl)
    state = HostState(gl)
    own = gl.framebuffer(texture(gl, np.zeros((7, 9, 4))), gl.depth_renderbuffer((9, 7)))
    bound, sampler = texture(gl, np.zeros((3, 3, 4))), gl.sampler()
    given = bake()
    given = given if kind == "surface" else Bake(given.gaussians, OverBlend(near=0.05))
    plain = IndirectLight(gl, given, splat_scale=1)
    textures = host.textures(gl, plain.encoding)
    frame = *textures, CAMERA.view_from_world, projection()
    expected = pixels(plain.draw(*frame))
    target = gl.framebuffer(colour := texture(gl, np.zeros((SIZE[1], SIZE[0], 4))))
    albedo = texture(gl, np.ones((SIZE[1], SIZE[0], 4)))

    own.use()
    gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    gl.depth_func, gl.blend_func = ">=", (moderngl.DST_COLOR, moderngl.ZERO)
    for unit in range(5):
        bound.use(unit)
        sampler.use(unit)
    odd = state.read() | {
        "VIEWPORT": (1, 2, 3, 4), "SCISSOR_TEST": (1,), "SCISSOR_BOX": (2, 1, 2, 3), "STENCIL_TEST": (1,),
        "BLEND 1": (1,), "COLOR_WRITEMASK 0": (1, 0, 1, 0), "DEPTH_WRITEMASK": (0,), "POLYGON_MODE": (0x1B01, 0x1B01),
        "COLOR_CLEAR": (0.25, 0.5, 0.75, 1.0), "DEPTH_CLEAR": (0.5,), "DEPTH_RANGE": (0.25, 0.75),
        "BLEND_EQUATION_RGB": (0x8007,), "ACTIVE_TEXTURE": (0x84C3,), "RASTERIZER_DISCARD": (1,), "DEPTH_CLAMP": (1,),
    }  # fmt: skip
    state.write(odd)
    assert state.read() == odd
    light = IndirectLight(gl, given, splat_scale=1)
    assert state.read() == odd
    made = light.draw(*frame)
    assert state.read() == odd
    light.add(target, albedo)
    assert state.read() == odd
    result, added = pixels(made), pixels(colour)[..., :3]
    state.write(odd)
    light.release()
    assert state.read() == odd
    np.testing.assert_array_equal(result, expected)
    np.testing.assert_array_equal(added, expected[..., :3])
    assert gl.fbo.glo == own.glo
    with gl.scope(own, moderngl.BLEND):
        pass
    found = state.read()  # what moderngl remembers
    assert [found[name] for name in ("DEPTH_TEST", "CULL_FACE", "BLEND 0")] == [(1,), (1,), (0,)]


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
        ("clip_from_view", np.eye(4), np.eye(4)),
        ("clip_from_view", np.eye(4), projection() * np.nan),
        ("clip_from_view", np.eye(4), projection(reversed_depth=True)),
    ],
)
def test_matrices_that_are_no_camera_are_named(gl, host, light, name, view, clip):
    with pytest.raises(ValueError, match=name):
        light.draw(*host.textures(gl, light.encoding), view, clip)


def test_a_context_that_a_window_made_will_do(gl, host):
    """moderngl attached to a current context, as in a host's window, finds OpenGL's functions in another way."""
    attached = moderngl.create_context()
    light = IndirectLight(attached, bake(), splat_scale=1)
    textures = host.textures(attached, light.encoding)
    drawn = pixels(light.draw(*textures, CAMERA.view_from_world, projection()))
    np.testing.assert_array_equal(drawn[..., :3], host.indirect.astype(np.float16))
    light.release()
