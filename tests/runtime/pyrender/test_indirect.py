"""The drop-in with baked light: albedo * B is added to what pyrender draws, before its curve."""

from dataclasses import replace

import numpy as np
import pytest
from gsgi_files import constant, surface_example
from pyrender_scenes import SIZE, blended, cameras, empty, from_behind, material, points, quad, solids, translation
from scipy.ndimage import binary_erosion
from surface_cases import grouped, with_relief

import gsgi
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.light_groups import weighted
from gsgi.runtime.pyrender import OffscreenRenderer, RenderFlags
from gsgi.runtime.scene import Material, Mesh, Scene

pytestmark = pytest.mark.usefixtures("pyrender", "current_again")

B = np.array([0.2, 0.3, 0.4])


@pytest.fixture
def draw(gl):
    """Draw a scene once: (scene, bake, flags, weights) to colour."""
    renderers = []

    def once(scene, bake=None, flags=RenderFlags.NONE, weights=None):
        renderers.append(OffscreenRenderer(*SIZE, gi=bake))
        if weights:
            renderers[-1].weights = weights
        return renderers[-1].render(scene, flags)[0]

    yield once
    for renderer in renderers:
        renderer.delete()


def assert_alike(a: np.ndarray, b: np.ndarray) -> None:
    """A B in half floats may move one level of 255; 1 % of pixels: edges with a sample of another surface."""
    off = np.abs(a.astype(int) - b)
    assert (off > 1).mean() < 0.01, (off.max(), (off > 1).mean())


# Ambient light adds `base colour * ambient`: so does a B that is the same everywhere, where no metal is black.
@pytest.mark.parametrize(("metallic", "effects"), [(0.0, Effects(0)), (0.8, Effects.METAL)])
@pytest.mark.parametrize("camera", [None, "far", "aspect", "intrinsics"])
def test_constant_light_equals_ambient_light(pyrender, draw, camera, metallic, effects):
    scene = solids(camera and cameras()[camera], ambient_light=np.zeros(3))
    for node in scene.mesh_nodes:
        node.mesh.primitives[0].material.metallicFactor = metallic
    lit = draw(scene, replace(constant(B), effects=effects))
    without = draw(scene)
    scene.ambient_light = B
    assert_alike(lit, draw(scene))
    assert np.abs(lit.astype(int) - without).max() > 20


def test_black_metal_takes_none_of_it(pyrender, draw):
    scene = solids(ambient_light=np.zeros(3))
    for node in scene.mesh_nodes:
        node.mesh.primitives[0].material.metallicFactor = 1.0
    assert np.array_equal(draw(scene, constant(B)), draw(scene))


def test_vertex_colors_and_back_faces(pyrender, draw):
    scene = from_behind()
    scene.ambient_light = np.zeros(3)
    next(iter(scene.mesh_nodes)).mesh.primitives[0].color_0 = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    lit = draw(scene, constant(B), RenderFlags.SKIP_CULL_FACES)
    scene.ambient_light = B
    assert_alike(lit, draw(scene, flags=RenderFlags.SKIP_CULL_FACES))


def test_the_over_operator(pyrender, draw):
    scene = empty(eye=(0.3, 0.2, 2.0), ambient_light=np.zeros(3))
    scene.add(quad())
    lit = draw(scene, constant(B, "over"))
    scene.ambient_light = 0.99 * B  # as much as one Gaussian may cover
    assert_alike(lit, draw(scene))


@pytest.mark.parametrize("normals", [True, False], ids=["normals", "no_normals"])
def test_light_is_where_the_deferred_renderer_has_it(pyrender, gl, draw, normals):
    bake = surface_example(count=400, degree=1)
    scene = empty(eye=(0.3, 0.8, 2.2), ambient_light=np.zeros(3), bg_color=np.zeros(3))
    mesh = quad()
    if not normals:
        mesh.primitives[0].normals = None
    scene.add(mesh, pose=translation(0.2, 0.1, 0))
    node = scene.main_camera_node
    camera = Camera(scene.get_pose(node), node.camera.yfov, node.camera.znear)
    primitive = mesh.primitives[0]
    position = primitive.positions + np.float32([0.2, 0.1, 0])
    normal = np.tile(np.float32([0, 0, 1]), (4, 1))
    triangle = primitive.indices.astype(np.uint32)
    triangles = Mesh(position, normal, np.zeros((4, 0, 2), np.float32), triangle, 0)
    deferred = DeferredRenderer(gl, Scene((triangles,), (Material(),)), bake, *SIZE)
    deferred.render(camera)
    light, seen_depth = deferred.read("indirect"), deferred.read("depth")
    deferred.release()
    base = np.array(primitive.material.baseColorFactor[:3])
    expected = np.clip(255 * (base * light) ** (1 / 2.2), 0, 255)
    inner = binary_erosion(seen_depth > 0)  # without the edges' partly covered pixels
    off = np.abs(draw(scene, bake) - expected)[inner]
    assert inner.mean() > 0.1
    assert expected[inner].std() > 10
    assert (off > 1.5).mean() < 0.01, (off.max(), (off > 1.5).mean())


def test_a_file_gives_the_same_as_its_bake(pyrender, draw, tmp_path):
    path = tmp_path / "room.gsgi"
    path.write_bytes(codec.encode(surface_example()))
    assert np.array_equal(draw(solids(), path), draw(solids(), codec.decode(path.read_bytes())))


@pytest.mark.parametrize("flags", [RenderFlags.FLAT, RenderFlags.SEG, RenderFlags.ALL_WIREFRAME])
def test_what_has_no_surface_has_no_indirect_light(pyrender, draw, flags):
    assert np.array_equal(draw(solids(), constant(B), flags), draw(solids(), None, flags))


def test_points_stay_as_they_are(pyrender, draw):
    assert np.array_equal(draw(points(), constant(B)), draw(points()))


@pytest.mark.parametrize("normals", [True, False], ids=["normals", "no_normals"])
def test_blended_panes_are_lit_like_solids(pyrender, draw, normals):
    scene = blended()
    scene.ambient_light = np.zeros(3)
    for node in scene.mesh_nodes:
        node.mesh.primitives[0].normals = node.mesh.primitives[0].normals if normals else None
    lit, without = draw(scene, constant(B)), draw(scene)
    scene.ambient_light = B
    off = np.abs(lit.astype(int) - draw(scene))
    assert (off > 2).mean() < 0.01  # both panes and what is behind them are rounded one after the other
    assert np.abs(lit.astype(int) - without).max() > 20


def test_blended_panes_have_no_light_of_the_over_operator(pyrender, draw):
    scene = blended()
    for node in list(scene.mesh_nodes):
        if not node.mesh.is_transparent:
            scene.remove_node(node)
    assert np.array_equal(draw(scene, constant(B, "over")), draw(scene))


def test_a_pane_reads_the_light_where_it_is(pyrender, draw):
    """A pane of next to full alpha looks like the same quad as a solid, under light that changes over it."""
    bake, pictures = surface_example(count=400, degree=1), []
    for alpha, mode in ((1.0, "OPAQUE"), (0.999, "BLEND")):
        scene = empty(eye=(0.3, 0.8, 2.2), ambient_light=np.zeros(3), bg_color=np.zeros(3))
        scene.add(quad(material=material((0.8, 0.5, 0.3, alpha), alphaMode=mode)), pose=translation(0.2, 0.1, 0))
        pictures.append(draw(scene, bake))
    assert next(iter(scene.mesh_nodes)).mesh.is_transparent
    assert pictures[0].std() > 20
    assert_alike(*pictures)


def test_light_is_kept_from_surface_to_surface(pyrender, draw):
    """An edge pixel with samples of two surfaces takes the light of both: no dark rim around what is in front."""
    scene = solids(lit=False, ambient_light=np.zeros(3), bg_color=np.zeros(3))
    for node in scene.mesh_nodes:
        node.mesh.primitives[0].material = quad().primitives[0].material
    lit = draw(scene, constant(B))
    scene.ambient_light = B
    assert np.array_equal(lit.any(axis=-1), draw(scene).any(axis=-1))


def test_the_over_operator_refuses_an_orthographic_camera(pyrender, draw):
    scene = solids(cameras()["orthographic"])
    with pytest.raises(UnsupportedError, match="OrthographicCamera"):
        draw(scene, constant(B, "over"))


@pytest.mark.parametrize("alpha", [1.0, 0.5])
def test_an_orthographic_camera_sees_the_light_at_its_points(pyrender, draw, alpha):
    """A square that fills the view: each pixel is a known point."""
    bake = surface_example(count=400, degree=1)
    camera = pyrender.OrthographicCamera(0.75, 0.75 * SIZE[1] / SIZE[0], znear=0.1)
    scene = empty(camera, eye=(1e-9, 0, 2), ambient_light=np.zeros(3), bg_color=np.zeros(3))
    mesh = quad()
    mesh.primitives[0].material = material((0.8, 0.5, 0.3, alpha), alphaMode="BLEND" if alpha < 1 else "OPAQUE")
    scene.add(mesh)
    drawn = draw(scene, bake)
    x, y = (0.75 * (2 * (np.arange(n) + 0.5) / SIZE[0] - n / SIZE[0]) for n in SIZE)
    x, y = np.meshgrid(x, -y)
    at = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    light = gsgi.sample(bake, at, np.tile([0.0, 0, 1], (len(at), 1))).reshape(*x.shape, 3)
    color = mesh.primitives[0].material.baseColorFactor
    expected = 255 * alpha * np.clip(light * color[:3], 0, 1) ** (1 / 2.2)  # pyrender blends after its curve
    inside = (np.abs(x) < 0.7) & (np.abs(y) < 0.7)
    assert expected[inside].mean() > 40
    assert (np.abs(drawn - expected).max(axis=-1)[inside] > 2).mean() < 0.02


@pytest.mark.parametrize("alpha", [1.0, 0.5])
@pytest.mark.parametrize("side", [1, -1], ids=["front", "back"])
def test_light_follows_normal_maps(pyrender, draw, alpha, side):
    """A square with a normal map that fills the view: each pixel is a known point with a known normal."""
    bake, texel = with_relief(surface_example(count=400, degree=1)), np.array([60, 170, 210], np.uint8)
    camera = pyrender.OrthographicCamera(0.75, 0.75 * SIZE[1] / SIZE[0], znear=0.1)
    scene = empty(camera, eye=(1e-9, 0, 2 * side), ambient_light=np.zeros(3), bg_color=np.zeros(3))
    mode = "BLEND" if alpha < 1 else "OPAQUE"
    bumps = np.broadcast_to(texel, (4, 4, 3))
    scene.add(quad(material=material((0.3, 0.3, 0.3, alpha), alphaMode=mode, doubleSided=True, normalTexture=bumps)))
    drawn = draw(scene, bake)
    x, y = (0.75 * (2 * (np.arange(n) + 0.5) / SIZE[0] - n / SIZE[0]) for n in SIZE)
    x, y = np.meshgrid(side * x, -y)
    at = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    plane, bent = (np.broadcast_to(side * np.array(n), at.shape) for n in ([0.0, 0, 1], texel / 127.5 - 1))
    mapped, flat = (gsgi.sample(bake, at, plane, mapped=each).reshape(*x.shape, 3) for each in (bent, plane))
    inside = (np.abs(x) < 0.7) & (np.abs(y) < 0.7)
    expected, unbent = (255 * alpha * np.clip(0.3 * light, 0, 1) ** (1 / 2.2) for light in (mapped, flat))
    assert np.abs(expected - unbent)[inside].mean() > 10 * alpha
    assert (np.abs(drawn - expected).max(axis=-1)[inside] > 2).mean() < 0.02


def test_a_shifted_image_centre_shifts_the_light(pyrender, draw):
    bake, pictures = surface_example(count=400, degree=1), []
    for cx, cy in ((48, 32), (56, 27)):
        camera = pyrender.IntrinsicsCamera(80, 100, cx, cy)
        scene = empty(camera, eye=(0.3, 0.8, 2.2), ambient_light=np.zeros(3))
        scene.add(quad())
        pictures.append(draw(scene, bake))
    assert pictures[0][5:, :-8].std() > 20
    assert_alike(pictures[0][5:, :-8], pictures[1][:-5, 8:])


def test_weights_dim_lights_and_indirect_light(pyrender, draw):
    """As if the lights, the emission and the bake had been darker."""
    made = grouped(surface_example())
    weights = {"lamps": 0.25, "sky": (1, 0.5, 2)}

    def scene(factor: float = 1.0):
        import pyrender

        drawn = solids(ambient_light=np.zeros(3))
        for node in drawn.light_nodes:
            if isinstance(node.light, pyrender.PointLight):
                node.name, node.light.intensity = "lamp 1", factor * node.light.intensity
        glowing = drawn.get_nodes(name="ball").pop().mesh.primitives[0].material
        glowing.name, glowing.emissiveFactor = "lamp 2", np.sqrt(factor) * np.array([0.5, 0.4, 0.3])
        return drawn

    expected = draw(scene(0.25), replace(weighted(made, weights), groups=()))
    dimmed = draw(scene(), made, weights=weights)
    assert_alike(dimmed, expected)
    assert np.abs(dimmed.astype(int) - draw(scene(), made)).max() > 20
    np.testing.assert_array_equal(draw(scene(), made), draw(scene(), replace(made, groups=())))


def test_unknown_weights_are_named(pyrender):
    renderer = OffscreenRenderer(*SIZE, gi=grouped(surface_example()))
    with pytest.raises(
        ValueError, match=r"^weights: the bake has no light group 'lamp': it has 'base', 'lamps', 'sky'"
    ):
        renderer.weights = {"lamp": 1}
    assert renderer.weights["lamps"] == (1, 1, 1)
    renderer.delete()
    without = OffscreenRenderer(*SIZE)
    with pytest.raises(ValueError, match=r"^weights: there is no `gi`"):
        without.weights = {"lamps": 1}
    without.delete()
