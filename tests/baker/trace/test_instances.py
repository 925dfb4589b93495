"""Copies of meshes: rays meet what they would meet if each copy had arrays of its own, and memory holds it once."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from instanced import BUMPY, MATERIALS, PLACES, TURNED, flattened, placed, scene, thing

from gsgi.baker.trace.instances import grouped, surfaces_of
from gsgi.baker.trace.surface_tables import tabulate
from gsgi.baker.trace.tracer import Sampling, Tracer
from gsgi.baker.trace.visible import Surface
from gsgi.runtime import instance
from gsgi.runtime.camera import look_at
from gsgi.runtime.errors import SceneError
from gsgi.runtime.instance import Instance
from gsgi.runtime.scene import Environment, Light, Material, Mesh, Scene


@pytest.fixture(autouse=True)
def shared(monkeypatch):
    """Even the smallest copies are shared."""
    monkeypatch.setattr(instance, "SHARED", 1)


def seen(tracer: Tracer) -> Surface:
    return tracer.surface(
        look_at(np.array([0.3, 2.5, 2.6]), np.array([0.1, 0.3, 0.0]), np.eye(3)[1], 1.0, 0.01), 48, 48
    )


@pytest.mark.parametrize("material", ["opaque", "masked", "filter"])
@pytest.mark.parametrize("place", PLACES)
def test_copies_give_the_light_of_flat_meshes(place, material):
    of = scene(MATERIALS[material], placed(np.eye(3), (-0.7, 0.1, 0)), placed(PLACES[place], (0.7, 0.4, 0.2)))
    shared, single = Tracer(of), Tracer(flattened(of))
    assert surfaces_of(of)[0].placed is not None
    assert surfaces_of(flattened(of))[0].placed is None
    ours, theirs = seen(shared), seen(single)
    same = ours.valid & theirs.valid
    assert (ours.valid == theirs.valid).mean() > 0.998
    for name in ("position", "normal", "shading_normal", "geometric_normal", "albedo", "depth"):
        off = np.abs(getattr(ours, name) - getattr(theirs, name))[same]
        assert np.quantile(off, 0.995) < 2e-3, name
    points = tuple(array[same & theirs.diffuse] for array in (theirs.position, theirs.normal, theirs.geometric_normal))
    first, second = (tracer.indirect(*points, Sampling(64, bounces=4), 0).mean for tracer in (shared, single))
    assert first.mean() == pytest.approx(second.mean(), rel=2e-3)
    assert np.quantile(np.abs(first - second), 0.9) < 1e-3  # nearly all paths are the same
    bright, other = (tracer.direct(*points) for tracer in (shared, single))
    assert (np.abs(bright - other).max(axis=1) > 1e-3).mean() < 0.01


def test_copies_that_emit_light_stand_for_themselves():
    of = scene(MATERIALS["lamp"], placed(np.eye(3), (-0.7, 0.1, 0)), placed(TURNED, (0.7, 0.4, 0.2)))
    single, groups = grouped(of)
    assert (len(single), groups) == (3, [])


def test_memory_grows_by_places_and_not_by_triangles():
    few, many = (
        surfaces_of(scene(BUMPY, *(placed(np.eye(3), (2 * i, 0.1, 0)) for i in range(count))))[0] for count in (2, 50)
    )
    assert len(few.triangle) == len(many.triangle)
    assert len(many.placed.matrix) == 50
    for name in ("position", "triangle", "face", "plane", "normal", "tangent", "uv", "color"):
        assert getattr(few, name).nbytes == getattr(many, name).nbytes


def test_meshes_that_stand_in_the_same_places_are_one_group():
    shape, base = thing(), placed(TURNED, (1, 2, 3))
    copies = [
        Instance(replace(shape), placed(np.eye(3), (4.0 * i, 0, 0)) @ own, 1)
        for own in (np.eye(4), base)
        for i in range(3)
    ]
    copies = [replace(copy, shape=copies[3 * (i // 3)].shape) for i, copy in enumerate(copies)]
    (group,) = grouped(replace(scene(BUMPY), meshes=tuple(copies)))[1]
    assert (len(group.meshes), len(group.places)) == (2, 3)
    np.testing.assert_array_equal(group.meshes[1].position, copies[3].position)


def solid() -> Mesh:
    """A closed box of half a metre."""
    walls = scenes.box(0.25, 1, inward=False)
    position, normal, uv = (np.concatenate([getattr(m, name) for m in walls]) for name in ("position", "normal", "uv"))
    triangle = np.concatenate([wall.triangle + np.uint32(4 * k) for k, wall in enumerate(walls)])
    return Mesh(position, normal, uv, triangle, 1)


@pytest.mark.parametrize(
    ("heights", "single"),
    [((0.3, 1, 2), 0), ((0.25, 1, 2), 2), ((1, 1.5, 2.5), 4), ((0.25, 0.75, 2.5), 4), ((0.6, 0.6, 2), 12)],
    ids=["nothing", "on the floor", "on another", "both", "in the same place"],
)
def test_what_lies_on_something_else_in_one_place_stands_for_itself_in_all(heights, single):
    """Boxes above a floor of two triangles: `single` of the box's twelve are moved where they lie on others."""
    matrices = [placed(np.eye(3), (0, height, 0)) for height in heights]
    surfaces, _ = surfaces_of(scene(Material("grey"), *matrices, mesh=solid()))
    hidden = 12 if single == 12 else 0  # twice in the same place
    assert surfaces.single == 2 + 3 * single - hidden
    assert len(surfaces.triangle) - surfaces.single == 12 - single


def test_faces_on_each_other_in_a_copy_are_moved_apart_in_all_places():
    """A sheet of two faces back to back, each of which is seen from its side alone."""
    front = scenes.floor(0.5, 0.3, 1)
    back = replace(scenes.floor(0.5, 0.3, 2), triangle=front.triangle[:, ::-1].copy(), normal=-front.normal)
    places = [placed(turn, (1.5 * i, 0.7 * i, 0)) for i, turn in enumerate((np.eye(3), TURNED, 1.5 * TURNED))]
    white, black = (Material(base_color=(value, value, value, 1.0)) for value in (1.0, 0.0))
    copies = tuple(Instance(mesh, place, mesh.material) for mesh in (front, back) for place in places)
    tracer = Tracer(Scene((scenes.floor(9.0, -5.0), *copies), (scenes.WHITE, white, black)))
    for place in places:
        points = np.random.default_rng(1).uniform(-0.45, 0.45, (300, 3)) * [1, 0, 1] + [0, 0.3, 0]
        there, up = points @ place[:3, :3].T + place[:3, 3], place[:3, 1] / np.linalg.norm(place[:3, 1])
        for side, albedo in ((1.0, 1.0), (-1.0, 0.0)):
            hits = tracer._first_hits(there + 0.2 * side * up, np.tile(-side * up, (300, 1)))
            assert hits["valid"].all()
            np.testing.assert_allclose(hits["albedo"], albedo)


@pytest.mark.parametrize("far", [30.0, 1e3])
def test_rays_neither_leak_through_copies_nor_meet_the_surface_that_they_leave(far):
    grey = Material("grey", (0.5, 0.5, 0.5, 1.0))
    sky = Environment(np.ones((1, 1, 3), np.float32))
    sun = Light("directional", np.ones(3), np.zeros(3), np.array([0.36, -0.8, 0.48]))
    for inward in (True, False):
        walls = scenes.box(1.0, 0, inward)
        matrices = placed(np.eye(3), (-far, 0, 0)), placed(TURNED * 1.3, (far, 0.5 * far, far))
        copies = tuple(Instance(wall, matrix, 0) for wall in walls for matrix in matrices)
        tracer = Tracer(Scene(copies, (grey,), lights=(sun,), environment=sky))
        rng = np.random.default_rng(0)
        which = rng.integers(6, size=500)
        local = rng.dirichlet((1, 1, 1, 1), 500)
        local = np.array([walls[k].position.T @ weights for k, weights in zip(which, local, strict=True)])
        position = local @ matrices[1][:3, :3].T + matrices[1][:3, 3]
        normal = np.array([walls[k].normal[0] for k in which]) @ TURNED.T
        points = position.astype(np.float32), *(normal.astype(np.float32),) * 2
        light = tracer.indirect(*points, Sampling(32), 0)
        if inward:
            assert not light.mean.any()
        else:
            assert np.mean(light.mean > 1 - 1e-5) > 0.98  # few paths meet the other box
            cosine = np.maximum(-normal @ sun.direction, 0) / np.pi
            np.testing.assert_allclose(tracer.direct(*points)[:, 0], cosine, atol=1e-5)


def test_more_triangles_and_places_than_numbers_are_refused():
    of = scene(BUMPY, *(placed(np.eye(3), (2 * i, 0.1, 0)) for i in range(4)))
    single, groups = grouped(of)
    many = [groups[0]._replace(places=np.broadcast_to(np.eye(4), (1 << 24, 4, 4)))]
    with pytest.raises(SceneError, match="places of copies: their product is beyond"):
        tabulate(replace(of, meshes=single), many)
