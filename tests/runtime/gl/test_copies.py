"""Copies of meshes: drawn as meshes of their own would be, from one copy of their arrays, where they may be seen."""

from dataclasses import replace

import moderngl
import numpy as np
import pytest
from instanced import MATERIALS, PLACES, flattened, placed, scene, thing

from gsgi.runtime import instance
from gsgi.runtime.camera import look_at
from gsgi.runtime.gl.copies import Copies
from gsgi.runtime.gl.geometry import Geometry
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.instance import ShapeGroup
from gsgi.runtime.scene import Light

CAMERA = look_at(np.array([0.3, 2.5, 2.6]), np.array([0.1, 0.3, 0.0]), np.eye(3)[1], 1.0, 0.01)
LAYERS = "albedo", "normal", "depth", "primary", "final"
LAMP = Light("point", np.full(3, 4.0), np.array([0.2, 1.6, 0.9]), np.zeros(3))


@pytest.fixture(autouse=True)
def shared(monkeypatch):
    """Even the smallest copies are shared."""
    monkeypatch.setattr(instance, "SHARED", 1)


def drawn(gl, of) -> dict[str, np.ndarray]:
    renderer = DeferredRenderer(gl, of, None, 96, 72)
    renderer.render(CAMERA)
    layers = {layer: renderer.read(layer) for layer in LAYERS}
    renderer.release()
    return layers


def check(gl, of):
    """The frame of a scene is that of flat meshes, but for pixels at edges."""
    ours, theirs = drawn(gl, of), drawn(gl, flattened(of))
    for layer in LAYERS:
        off = np.abs(ours[layer] - theirs[layer]).reshape(72 * 96, -1).max(axis=1)
        assert (off < 4e-3).mean() > 0.997, (layer, (off < 4e-3).mean())


@pytest.mark.parametrize("material", ["opaque", "masked", "lamp"])
@pytest.mark.parametrize("place", PLACES)
def test_copies_look_as_flat_meshes_do(gl, place, material):
    first, second = placed(np.eye(3), (-0.7, 0.1, 0)), placed(PLACES[place], (0.7, 0.4, 0.2))
    of = scene(MATERIALS[material], first, first @ placed(np.eye(3), (0, 0.7, -0.6)), second)
    of = replace(of, lights=(*of.lights, LAMP))
    (batch,) = [b for b in Geometry(gl, of).batches if b.copies and "tangent" in b.attributes][:1]
    assert "color" in batch.attributes
    check(gl, of)
    one_sided = replace(of, materials=tuple(replace(m, double_sided=False) for m in of.materials))
    check(gl, one_sided)


def test_blended_copies_look_as_flat_meshes_do(gl):
    of = scene(MATERIALS["opaque"], placed(np.eye(3), (-0.7, 0.1, 0)), placed(PLACES["turned"], (0.7, 0.4, 0.2)))
    glass = replace(of.materials[1], base_color=(0.9, 0.4, 0.2, 0.4))
    of = replace(of, meshes=of.meshes[:1], blended=of.meshes[1:], materials=(of.materials[0], glass))
    flat = replace(of, blended=tuple(mesh.flat() for mesh in of.blended))
    ours, theirs = drawn(gl, of)["final"], drawn(gl, flat)["final"]
    assert (np.abs(ours - theirs).max(axis=2) < 4e-3).mean() > 0.997
    assert np.abs(ours - drawn(gl, replace(of, blended=()))["final"]).max() > 0.1


def test_far_copies_look_as_they_do_at_the_origin(gl):
    of = scene(MATERIALS["opaque"], placed(np.eye(3), (-0.75, 0.125, 0)), placed(np.eye(3), (0.75, 0.5, 0.25)))
    away = np.array([2.0**17, 0.0, -(2.0**16)])
    far = replace(
        of,
        meshes=tuple(
            replace(m, world_from_shape=placed(np.eye(3), away) @ m.world_from_shape)
            if isinstance(m, instance.Instance)
            else replace(m, position=(m.position + away).astype(np.float32))
            for m in of.meshes
        ),
    )
    renderer, near = DeferredRenderer(gl, far, None, 96, 72), drawn(gl, of)
    pose = CAMERA.world_from_view.copy()
    pose[:3, 3] += away
    renderer.render(replace(CAMERA, world_from_view=pose))
    for layer in LAYERS:
        assert (np.abs(renderer.read(layer) - near[layer]) < 4e-3).mean() > 0.997, layer
    renderer.release()


def test_arrays_are_there_once(gl):
    def uploaded(count: int) -> int:
        geometry = Geometry(gl, scene(MATERIALS["opaque"], *(placed(np.eye(3), (2 * i, 0, 0)) for i in range(count))))
        found = {id(b): b.size for batch in geometry.batches for b in (batch.indices, *batch.attributes.values())}
        geometry.release()
        return sum(found.values())

    assert uploaded(2) == uploaded(50)


def test_few_triangles_in_copies_are_drawn_at_once_with_others(gl, monkeypatch):
    monkeypatch.setattr(instance, "SHARED", len(thing().triangle) + 1)
    of = scene(MATERIALS["opaque"], placed(np.eye(3), (-0.7, 0.1, 0)), placed(np.eye(3), (0.7, 0.4, 0.2)))
    assert [batch.copies for batch in Geometry(gl, of).batches] == [None, None]


def test_copies_in_view_are_drawn_and_others_are_not(gl):
    rng = np.random.default_rng(0)
    places = np.tile(np.eye(4), (400, 1, 1))
    places[:, :3, :3] += rng.normal(0, 0.4, (400, 3, 3))
    places[:, :3, 3] = rng.uniform(-6, 6, (400, 3))
    mesh = thing()
    copies = Copies(gl, ShapeGroup((mesh,), places))
    clip = CAMERA.clip_from_view(1.5) @ CAMERA.view_from_world
    copies.cull(clip)
    world = np.einsum("pij,vj->pvi", places[:, :3, :3], mesh.position) + places[:, None, :3, 3]
    x, y, z, w = np.moveaxis(np.concatenate([world, np.ones_like(world[..., :1])], axis=2) @ clip.T, -1, 0)
    inside = ((np.abs(x) < w) & (np.abs(y) < w) & (np.abs(z) < w)).any(axis=1)
    rows = np.frombuffer(copies.buffer.read(), np.float32).reshape(400, 25)[: copies.count]
    drawn_places = rows[:, :16].reshape(-1, 4, 4).transpose(0, 2, 1)
    shown = (np.abs(drawn_places[None] - places[:, None].astype(np.float32)).max(axis=(2, 3)) == 0).any(axis=1)
    assert shown[inside].all()
    assert 0 < inside.sum() <= copies.count < 0.6 * len(places)
    copies.buffer.release()


def test_nothing_is_drawn_behind_the_camera(gl, monkeypatch):
    of = scene(MATERIALS["opaque"], placed(np.eye(3), (0, 0, 9)), placed(np.eye(3), (1, 0, 9)))
    counts = []
    render = moderngl.VertexArray.render
    monkeypatch.setattr(
        moderngl.VertexArray, "render", lambda self, *a, **k: counts.append(k.get("instances")) or render(self, *a, **k)
    )
    renderer = DeferredRenderer(gl, replace(of, lights=()), None, 16, 16)
    renderer.render(CAMERA)
    renderer.release()
    assert counts.count(1) == 1  # the floor
    assert not {0, 2} & set(counts)
