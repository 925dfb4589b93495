"""The look-up in GLSL: at any point, in any stage, what the passes give."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from glsl_lookup import read
from surface_cases import bent, gaussians, points, with_relief
from surface_frames import CAMERA, SIZE, draw, nothing, one, room, surface_gaussians

import gsgi
from gsgi.runtime.constants import GLSL_FOLDER
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Bake, Gaussians, OverBlend, SurfaceBlend
from gsgi.runtime.gl import lookup_textures, shader
from gsgi.runtime.gl.indirect_lookup import IndirectLookup, lookup_source
from gsgi.runtime.lookup_tables import HEADER_TEXELS, lookup_tables

TOLERANCE = 1e-3


def assert_equals_sample(gl, bake, position, normal):
    light = read(gl, bake, position, normal)
    np.testing.assert_allclose(light, gsgi.sample(bake, position, normal), rtol=TOLERANCE, atol=TOLERANCE)
    return light


@pytest.mark.parametrize(("degree", "sloped"), [(0, False), (0, True), (1, False), (2, True)])
@pytest.mark.parametrize("floor", [0.05, 0.5])
def test_random_points(gl, degree, sloped, floor):
    levels = gaussians(60, (degree + 1) ** 2, sloped=sloped), gaussians(20, 9, seed=7)
    bake = Bake(levels[0], SurfaceBlend(cutoff=0.1, sharpness=3, floor=floor), coarse=levels[1])
    position, normal = points(2000)
    light = read(gl, bake, position, normal)
    sums, expected = oracle.read_surface(*levels, bake.blend, position.astype(float), normal.astype(float))
    clear = ((sums[..., 3] > 1e-5) | (sums[..., 3] == 0)).all(axis=0)
    assert (sums[0, clear, 3] < floor).mean() > 0.1  # the coarse level counts
    np.testing.assert_allclose(light[clear], expected[clear], rtol=TOLERANCE, atol=TOLERANCE)


@pytest.mark.parametrize("bumpy", [False, True])
def test_free_space_has_the_light_of_the_coarse_level_alone(gl, bumpy):
    bake = Bake(gaussians(60, 1), SurfaceBlend(cutoff=0.1), coarse=gaussians(20, 9, seed=7))
    bake, where = with_relief(bake) if bumpy else bake, points(2000)
    expected = gsgi.sample(bake, *where, free=True)
    np.testing.assert_allclose(read(gl, bake, *where, free=True), expected, rtol=TOLERANCE, atol=TOLERANCE)


@pytest.mark.parametrize(("degree", "sloped"), [(0, True), (2, False)])
def test_light_follows_normal_maps(gl, degree, sloped):
    levels = gaussians(60, (degree + 1) ** 2, sloped=sloped), gaussians(20, 9, seed=7)
    bake = with_relief(Bake(levels[0], SurfaceBlend(cutoff=0.1, sharpness=3, floor=0.2), coarse=levels[1]))
    position, normal = points(2000)
    mapped = bent(normal)
    assert_equals_sample(gl, bake, position, normal)
    flat = replace(bake, gaussians=replace(bake.gaussians, relief=None))
    np.testing.assert_array_equal(read(gl, bake, position, normal), read(gl, flat, position, normal))
    light = read(gl, bake, position, normal, mapped)
    expected = gsgi.sample(bake, position, normal, mapped=mapped)
    np.testing.assert_allclose(light, expected, rtol=TOLERANCE, atol=TOLERANCE)
    unbent = read(gl, flat, position, normal, mapped)
    np.testing.assert_array_equal(unbent, read(gl, flat, position, normal))  # a file without relief looks at none
    assert np.abs(light - unbent).mean() > 0.02


@pytest.mark.parametrize("free", [False, True])
def test_normals_that_point_nowhere_get_no_light(gl, free):
    bake = Bake(gaussians(60, 4), SurfaceBlend(floor=0.5), coarse=gaussians(20, 9, seed=7))
    position, _ = points(90)
    for nowhere in (0, np.nan):
        normal = np.full_like(position, nowhere)
        np.testing.assert_array_equal(read(gl, bake, position, normal, free=free), 0)
        np.testing.assert_array_equal(gsgi.sample(bake, position, normal, free=free), 0)
    assert read(gl, bake, position, position, free=free).any()


def test_without_relief_no_texel_is_added():
    fine, coarse = gaussians(60, 4), gaussians(20, 9)
    bake = Bake(fine, SurfaceBlend(), coarse=coarse)
    assert len(lookup_tables(bake)[0]) == HEADER_TEXELS + 60 * (3 + 4) + 20 * (3 + 9)
    assert len(lookup_tables(with_relief(bake))[0]) == HEADER_TEXELS + 60 * (3 + 4 + 3) + 20 * (3 + 9)


def test_every_point_of_a_frame_equals_the_pass(gl):
    """A forward pass over the same triangles, beside the deferred one."""
    scene, fine, coarse = room(), surface_gaussians(room(), 1000), oracle.random_gaussians(30, 2, seed=1)
    indirect, depth, _ = draw(gl, fine, coarse, scene)
    lookup = IndirectLookup(gl, Bake(fine, SurfaceBlend(), coarse=coarse))
    program = gl.program(
        vertex_shader=shader.CORE + "in vec3 position; in vec3 normal; uniform mat4 clip_from_world; out vec3 x, n;"
        "void main() { x = position; n = normal; gl_Position = clip_from_world * vec4(x, 1.0); }",
        fragment_shader=shader.CORE + lookup.source + "in vec3 x, n; out vec4 light;"
        "void main() { light = vec4(gsgi_indirect(x, n), 1.0); }",
    )  # fmt: skip
    clip_from_world = CAMERA.clip_from_view(SIZE[0] / SIZE[1]) @ CAMERA.view_from_world
    shader.set_uniforms(program, clip_from_world=clip_from_world)
    target = gl.framebuffer(gl.texture(SIZE, 4, dtype="f4"), gl.depth_renderbuffer(SIZE))
    target.use()
    target.clear()
    gl.enable_only(gl.DEPTH_TEST)
    gl.depth_func = "<"
    lookup.bind(program)
    for mesh in scene.meshes:
        corners = np.concatenate([mesh.position, mesh.normal], axis=1)[mesh.triangle.reshape(-1)].astype(np.float32)
        gl.vertex_array(program, [(gl.buffer(corners), "3f 3f", "position", "normal")]).render()
    light = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(SIZE[1], SIZE[0], 4)[::-1]
    same = (depth > 0) & (light[..., 3] > 0)
    assert same.mean() > 0.99
    off = np.abs(light[..., :3] - indirect)[same].max(axis=1) > TOLERANCE * (1 + indirect[same].max(axis=1))
    assert off.mean() < 0.002  # at edges, where both pick another triangle


def test_thin_sheets_with_opposite_normals(gl):
    sides = one(rotation=(0, 0, 0, 1), light=1.0), one(rotation=(1, 0, 0, 0), light=5.0)
    names = "position", "rotation", "scale", "opacity", "sh", "slope"
    both = Gaussians(*(np.concatenate([getattr(side, name) for side in sides]) for name in names))
    normal = np.array([[0, 0, 1], [0, 0, -3], [0, 0, 0]])
    light = read(gl, Bake(both, SurfaceBlend(), coarse=nothing()), np.zeros((3, 3)), normal)
    np.testing.assert_allclose(light, [[1] * 3, [5] * 3, [0] * 3], rtol=1e-5)


def test_at_the_cut_off_light_fades_to_nothing(gl):
    """One Gaussian alone: up to its rim it fades into the floor, where nobody else is; beyond, it is dark."""
    bake = Bake(one(scale=(0.3, 0.3, 0.1)), SurfaceBlend(), coarse=nothing())
    share = np.concatenate([np.linspace(0, 0.999, 200), 1 + np.array([-1e-4, -1e-6, 0, 1e-6, 1e-4, 0.01, 1])])
    position = np.outer(share * 0.3 * bake.blend.radius, [1, 0, 0])
    light = assert_equals_sample(gl, bake, position, np.tile([0.0, 1, 0], (len(share), 1)))
    assert (light[:100] > 0.9).all()
    assert (np.abs(light[-6:-2]) < 1e-3).all()
    np.testing.assert_array_equal(light[-2:], 0)


@pytest.mark.parametrize("scale", [(0.001, 0.03, 1), (30, 30, 0.05), (1e3, 1e3, 1e3), (1e-4, 1e-4, 1e-4)])
def test_sizes_that_hardly_fit(gl, scale):
    fine = gaussians(100, sloped=True)
    fine.scale[:50] = scale
    position, normal = points(500)
    position[:100] = fine.position  # the small ones too are reached
    light = assert_equals_sample(gl, Bake(fine, SurfaceBlend(), coarse=gaussians(5, 9)), position, normal)
    assert (light[:100] > 0).any()


def test_a_bake_far_from_the_origin(gl):
    far = np.float32([2e4, -1e4, 3e4])
    fine, (position, normal) = gaussians(60), points(300)
    moved = replace(fine, position=fine.position + far)
    assert_equals_sample(gl, Bake(moved, SurfaceBlend(), coarse=nothing()), position + far, normal)


@pytest.mark.parametrize("levels", [(nothing(), nothing(2)), (one(), nothing(2)), (nothing(), gaussians(4, 9))])
def test_empty_levels(gl, levels):
    assert_equals_sample(gl, Bake(levels[0], SurfaceBlend(), coarse=levels[1]), *points(200))


def test_more_gaussians_than_16_bits_count(gl):
    """Lists of 32 bits, and indices beyond the first 65,536."""
    rng = np.random.default_rng(0)
    few = gaussians(500)
    names = "position", "rotation", "scale", "opacity", "sh"
    many = Gaussians(*(np.repeat(getattr(few, name), 140, axis=0) for name in names))
    many.position[...] = rng.uniform(-1, 1, many.position.shape)
    many.scale[...] = 0.004
    bake = Bake(many, SurfaceBlend(), coarse=nothing())
    assert lookup_tables(bake)[2].dtype == np.uint32
    position, normal = points(300)
    position[:] = many.position[-300:]
    assert (assert_equals_sample(gl, bake, position, normal) > 0).any()


@pytest.mark.parametrize("stage", ["vertex", "fragment"])
@pytest.mark.parametrize("header", [shader.CORE, shader.ES], ids=["330", "300es"])
@pytest.mark.parametrize("bumpy", [False, True])
def test_it_compiles_in_every_stage(gl, stage, header, bumpy):
    call = "gsgi_indirect(vec3(1.0), vec3(0.0, 1.0, 0.0), vec3(0.6, 0.8, 0.0))"
    bake = Bake(gaussians(1, 4), SurfaceBlend(), coarse=gaussians(1, 9))
    source = lookup_source(with_relief(bake) if bumpy else bake)
    vertex, fragment = (header + (source if stage == each else "") for each in ("vertex", "fragment"))
    vertex += f"out vec3 v; void main() {{ v = {call if stage == 'vertex' else 'vec3(1.0)'}; "
    vertex += "gl_Position = vec4(v, 1.0); }"
    fragment += f"in vec3 v; out vec4 o; void main() {{ o = vec4({call if stage == 'fragment' else 'v'}, 1.0); }}"
    gl.program(vertex_shader=vertex, fragment_shader=fragment).release()


def test_the_header_of_the_texture_is_as_long_as_the_shader_takes_it():
    text = (GLSL_FOLDER / "surface" / "lookup.glsl").read_text(encoding="utf-8")
    assert f"#define LEVEL_TEXELS  {(HEADER_TEXELS - 2) // 2} " in text


def test_misuse_is_named(gl):
    lookup = IndirectLookup(gl, Bake(one(), SurfaceBlend(), coarse=nothing()))
    gl.error  # noqa: B018  reading it clears what earlier tests left
    for unit in (-1, 10_000):
        with pytest.raises(
            ValueError, match=rf"^unit: expected the first of three texture units, 0 to \d+, got {unit}$"
        ):
            lookup.use(unit)
    assert gl.error == "GL_NO_ERROR"
    for _ in range(2):
        lookup.release()
    for use in (lambda: lookup.use(0), lambda: setattr(lookup, "weights", {})):
        with pytest.raises(RuntimeError, match="IndirectLookup: it was released"):
            use()


def test_a_bake_of_the_other_operator_is_refused(gl):
    with pytest.raises(UnsupportedError, match="`over`"):
        IndirectLookup(gl, Bake(one(), OverBlend(near=0.1)))


def test_a_bake_that_the_textures_cannot_hold_is_refused(gl, monkeypatch):
    bake = Bake(gaussians(30), SurfaceBlend(), coarse=nothing())
    for name in ("EXACT", "DATA_WIDTH"):  # what can be counted, and what fits
        with monkeypatch.context() as patch:
            patch.setattr(lookup_textures, name, 100 if name == "EXACT" else 0)
            with pytest.raises(UnsupportedError, match="too many Gaussians: "):
                IndirectLookup(gl, bake)
