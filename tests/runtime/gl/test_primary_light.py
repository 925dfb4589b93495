"""Primary light of the renderer against that of the path tracer, for each kind of light and of surface.

The reference is what the exam compares with: emission, the environment, and for each punctual light a shadow
ray from a Lambertian surface.
"""

from dataclasses import replace

import mitsuba_twin
import numpy as np
import pytest
import scenes
from primary_error import primary_error
from repository import SHARED

from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.camera import look_at
from gsgi.runtime.gltf.reader import read_gltf
from gsgi.runtime.scene import Environment, Light, Material, Mesh, Scene, Texture, TextureSlot

SIZE = 128, 96
HALVES = 2**-10  # albedo, normal and the sum of the lights are rounded to the 11 bits of a half, each by half a step
TEXELS = 1 / 255  # software filters 8-bit textures in 8 bits
UP = np.array([0.0, 1.0, 0.0])
LAMP = np.array([-0.9, 1.8, 0.7])


def aimed(kind: str, position=LAMP, at=(0.2, 0.0, -0.1), **kwargs) -> Light:
    position = np.asarray(position, float)
    direction = np.asarray(at) - position
    color = np.array([3.0, 2.0, 1.0])
    return Light(kind, color, position, direction / np.linalg.norm(direction), **kwargs)


LIGHTS = {
    "point": aimed("point"),
    "point with a range": aimed("point", range=2.8),
    "point among the blocks": aimed("point", (0.1, 0.35, 0.45)),
    "spot": aimed("spot", cos_inner=0.95, cos_outer=0.8),
    "spot with a hard edge": aimed("spot", cos_inner=0.9, cos_outer=0.9),
    "spot with a range": aimed("spot", cos_inner=1.0, cos_outer=0.85, range=3.2),
    "wide spot": aimed("spot", cos_inner=0.6, cos_outer=0.1),
    "directional": aimed("directional"),
    "low sun": aimed("directional", (2.0, 0.5, 1.2)),
}
ALL = tuple(LIGHTS[name] for name in ("point with a range", "point among the blocks", "spot", "directional"))


def moved(meshes: list[Mesh], by, material: int) -> list[Mesh]:
    return [replace(mesh, position=mesh.position + np.float32(by), material=material) for mesh in meshes]


def ball(material: int, centre, radius: float = 0.25, rings: int = 12) -> Mesh:
    """A sphere of flat triangles with round normals."""
    v, u = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij")
    normal = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], axis=-1).reshape(-1, 3)
    corner = np.arange((rings + 1) * (2 * rings + 1)).reshape(rings + 1, -1)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangle = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).astype(np.uint32)
    area = np.linalg.norm(np.cross(*(normal[triangle[:, k]] - normal[triangle[:, 0]] for k in (1, 2))), axis=1)
    uv = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(np.float32) / np.float32(np.pi)
    position = (radius * normal + centre).astype(np.float32)
    return Mesh(position, normal.astype(np.float32), uv, triangle[area > 1e-9], material)


def stage(*lights: Light, floor=scenes.WHITE, thing=scenes.WHITE, textures=(), environment=None) -> Scene:
    """A floor and a wall, and things: a card that hovers, a block, a ball."""
    wall = scenes.quad([(-1.5, 0, -1), (1.5, 0, -1), (1.5, 1.5, -1), (-1.5, 1.5, -1)])
    things = [
        scenes.quad([(-0.6, 0.9, 0.2), (0.0, 0.9, 0.3), (0.0, 1.0, -0.3), (-0.6, 1.0, -0.4)], 1),
        *moved(scenes.box(0.2, inward=False), (0.5, 0.2, -0.2), 1),
        ball(1, (-0.2, 0.25, 0.1)),
    ]
    meshes = [scenes.floor(1.5), wall, *things]
    camera = look_at(np.array([0.3, 1.3, 2.4]), np.array([0.0, 0.4, 0.0]), UP, 0.8, 0.01)
    bent = {0: floor.normal_texture, 1: thing.normal_texture}
    meshes = [with_tangents(mesh) if bent[mesh.material] else mesh for mesh in meshes]
    return Scene(tuple(meshes), (floor, thing), textures, lights, environment, {"camera": camera})


def with_tangents(mesh: Mesh) -> Mesh:
    """Along a first guess, in the surface; not along uv, which nobody needs here."""
    guess = np.float32([0.9, 0.1, 0.42])
    along = guess - mesh.normal * (mesh.normal @ guess)[:, None]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return replace(mesh, tangent=np.concatenate([along, np.ones((len(along), 1), np.float32)], axis=1))


def noise(low=(60, 60, 60, 60), high=(240, 240, 240, 240)) -> np.ndarray:
    return np.random.default_rng(3).integers(low, high, (8, 8, 4)).astype(np.uint8)


def assert_equal_light(gl, scene: Scene, camera: str = "camera", size=SIZE):
    error = primary_error(gl, scene, scene.cameras[camera], *size)
    assert error.lit.sum() > 300
    assert error.total < HALVES + (TEXELS if scene.textures else 0)
    assert error.mean < 2 * TEXELS  # relative: the dim edges of cones and dark texels count as much as the rest
    assert error.wrong < 0.002
    return error


@pytest.mark.parametrize("name", LIGHTS)
def test_light(gl, name):
    error = assert_equal_light(gl, stage(LIGHTS[name]))
    assert error.counts.mean() > 0.8


def test_several_lights(gl):
    assert_equal_light(gl, stage(*ALL))


def test_emission_and_environment_seen_directly(gl):
    slot = TextureSlot(0)
    sky = Environment(np.random.default_rng(1).random((8, 16, 3), np.float32), 0.5)
    lamp = Material(base_color=(0.2, 0.3, 0.4, 1.0), emission=(2.0, 1.0, 0.5), emission_texture=slot)
    textures = (Texture(noise()),)
    assert_equal_light(gl, stage(thing=lamp, textures=textures, environment=sky))
    assert_equal_light(gl, stage(*ALL, thing=lamp, textures=textures, environment=sky))
    assert_equal_light(gl, stage(*ALL, thing=Material(base_color_texture=slot, unlit=True), textures=textures))


SLOT, BUMPS = TextureSlot(0), TextureSlot(1)
SURFACES = {
    "textured": Material(base_color=(0.9, 0.8, 0.7, 1.0), base_color_texture=SLOT),
    "metallic": Material(base_color_texture=SLOT, metallic=0.8, metallic_texture=SLOT),
    "normal-mapped": Material(normal_texture=BUMPS, normal_scale=0.6),
    "masked": Material(base_color_texture=SLOT, alpha_cutoff=0.5),
    "double-sided": Material(double_sided=True),
    "all": Material("", (0.9, 0.8, 0.7, 1.0), SLOT, 0.5, SLOT, BUMPS, 0.5, (0.1, 0.2, 0.3), SLOT, 0.5, True),
}


@pytest.mark.parametrize(
    ("name", "metals"), [*((name, "rough") for name in SURFACES), ("metallic", "black"), ("all", "black")]
)
def test_surface(gl, name, metals):
    material = SURFACES[name]
    bumps = noise((90, 90, 180, 0), (166, 166, 256, 256))
    textures = Texture(noise(), ("mirror", "repeat")), Texture(bumps, ("clamp", "repeat"))
    floor = replace(material, alpha_cutoff=None)  # what is seen of it does not depend on its own holes
    scene = replace(stage(*ALL, floor=floor, thing=material, textures=textures), metals=metals)
    error = assert_equal_light(gl, scene)
    assert error.counts.mean() > 0.8


def test_vertex_colors_and_nearest_texels(gl):
    scene = stage(*ALL, floor=Material(base_color_texture=SLOT), textures=(Texture(noise(), nearest=True),))
    generator = np.random.default_rng(5)
    colored = [replace(m, color=generator.random((len(m.position), 4), np.float32)) for m in scene.meshes]
    assert_equal_light(gl, replace(scene, meshes=tuple(colored)))


def test_card_seen_from_behind(gl):
    scene = stage(*ALL, thing=Material(double_sided=True))
    below = look_at(np.array([-0.3, 0.3, 1.2]), np.array([-0.3, 0.9, 0.0]), UP, 0.9, 0.01)
    assert_equal_light(gl, replace(scene, cameras={"camera": below}))


@pytest.mark.parametrize("name", ["point", "point among the blocks", "directional", "low sun"])
def test_the_reference_agrees_with_mitsubas_integrator(name):
    """Where Mitsuba has the same lights: neither ranges nor glTF's cones."""
    scene = stage(LIGHTS[name])
    surface = Tracer(scene).surface(scene.cameras["camera"], *SIZE)
    mine = Tracer(scene).direct(*surface.shading_points()) * surface.albedo[surface.diffuse]
    theirs = mitsuba_twin.radiance(scene, surface.position[surface.diffuse], scene.cameras["camera"].position, 1, 2)
    assert np.abs(mine - theirs).sum() < 1e-3 * theirs.sum()


@pytest.mark.parametrize(
    ("name", "camera"), [("sponza_crytek/sponza_sun", "atrium"), ("modern_hall/modern_hall", "camera")]
)
def test_real_scene(gl, name, camera):
    path = SHARED / f"{name}.gltf"
    if not path.exists():
        pytest.skip(f"needs {path}")
    assert_equal_light(gl, read_gltf(path), camera, (160, 160))
