"""What an edit has changed, by name."""

import json
from dataclasses import replace

import numpy as np
import scenes

from gsgi.baker.update.parts import BOXES, as_arrays, changes, from_arrays, kept_share, met_anew, parts
from gsgi.runtime.scene import Environment, Light, Material, Scene, Texture, TextureSlot

SUN = Light("directional", np.ones(3), np.zeros(3), np.array([0.0, -1.0, 0.0]), name="sun")
RED, BLUE = (Material(name, base_color=(*color, 1.0)) for name, color in (("red", (1, 0, 0)), ("blue", (0, 0, 1))))


def room() -> Scene:
    """A floor and a smaller table under a sun."""
    floor, table = replace(scenes.floor(2.0), name="floor"), replace(scenes.floor(1.0, 1.0, 1), name="table")
    return Scene((floor, table), (RED, BLUE), lights=(SUN,))


def lines(after: Scene) -> list[str]:
    return changes(parts(room()), parts(after))


def test_the_same_scene_has_the_same_parts_whatever_its_meshes_indices_and_cameras():
    scene = room()
    floor, table = scene.meshes
    other = (replace(table, material=0), replace(floor, material=1))
    assert not lines(replace(scene, meshes=other, materials=(BLUE, RED), cameras={"one": scenes.above_camera()}))


def test_what_has_changed_is_named():
    scene = room()
    floor, table = scene.meshes
    moved = replace(table, position=table.position + np.float32([1, 0, 0]))
    assert lines(replace(scene, meshes=(floor, moved))) == ["changed: object table"]
    assert lines(replace(scene, materials=(RED, replace(BLUE, base_color=(0, 1, 0, 1))))) == ["changed: material blue"]
    assert lines(replace(scene, lights=(replace(SUN, color=2 * SUN.color),))) == ["changed: light sun"]
    assert lines(replace(scene, meshes=(floor,), materials=(RED,))) == [
        "removed: object table",
        "removed: material blue",
    ]
    sky = Environment(np.ones((1, 1, 3), np.float32))
    assert lines(replace(scene, environment=sky)) == ["added: environment"]
    many = tuple(replace(table, name=f"chair {number}") for number in range(6))
    assert lines(replace(scene, meshes=(*scene.meshes, *many))) == [
        "added: object chair 0, chair 1, chair 2, chair 3 and 2 more"
    ]


def test_rays_meet_the_same_whatever_the_colours_and_lights():
    scene = room()
    floor, table = scene.meshes

    def same(**edit) -> bool:
        return not len(met_anew(parts(scene), parts(replace(scene, **edit))))

    bright = replace(BLUE, base_color=(0, 1, 0, 1), emission=(3, 3, 3), name="lamp")
    assert same(materials=(RED, bright), lights=())
    assert same(meshes=(table, floor))
    assert not same(meshes=(floor, replace(table, position=table.position + np.float32([1, 0, 0]))))
    assert not same(meshes=(floor,))
    for edit in ({"base_color": (0, 0, 1, 0.5)}, {"alpha_cutoff": 0.5}, {"metallic": 1.0}, {"double_sided": True}):
        assert not same(materials=(RED, replace(BLUE, **edit)))


def test_an_object_that_has_moved_is_met_anew_where_it_was_and_where_it_is():
    scene = room()
    floor, table = scene.meshes
    there = replace(table, position=table.position + np.float32([1, 0, 0]))
    before = from_arrays(json.loads(json.dumps(as_arrays(parts(scene)))))
    boxes = met_anew(before, parts(replace(scene, meshes=(floor, there))))
    assert sorted(boxes.tolist()) == sorted(np.array([table.bounds(), there.bounds()]).tolist())
    twice = met_anew(before, parts(replace(scene, meshes=(floor, table, table))))
    assert twice.tolist() == [np.array(table.bounds()).tolist()]


def test_of_many_objects_one_box_is_around_all():
    scene = room()
    floor, table = scene.meshes
    more = [replace(table, position=table.position + np.float32([n, 0, 0])) for n in range(1, BOXES + 2)]
    (box,) = met_anew(parts(scene), parts(replace(scene, meshes=(floor, table, *more))))
    assert box.tolist() == [more[0].bounds()[0].tolist(), more[-1].bounds()[1].tolist()]


def test_a_texture_counts_by_its_pixels():
    def textured(value: int, before: int) -> Scene:
        unused = (Texture(np.zeros((1, 1, 4), np.uint8)),) * before
        pixels = Texture(np.full((2, 2, 4), value, np.uint8))
        paint = replace(RED, base_color_texture=TextureSlot(before))
        return replace(room(), materials=(paint, BLUE), textures=(*unused, pixels))

    assert not changes(parts(textured(9, 0)), parts(textured(9, 1)))
    assert changes(parts(textured(9, 0)), parts(textured(8, 0))) == ["changed: material red"]


def test_the_share_that_is_kept_goes_by_area():
    scene = room()
    floor, table = scene.meshes
    assert kept_share(parts(scene), parts(scene)) == 1
    moved = replace(table, position=table.position + np.float32([1, 0, 0]))
    after = parts(replace(scene, meshes=(floor, moved)))
    np.testing.assert_allclose(kept_share(parts(scene), after), 16 / 20)
    beside = np.array([[-2.0, -1, -2], [-1.5, 1, 2]])  # into which only the floor reaches
    assert kept_share(parts(scene), after, beside) == 1
    assert kept_share(parts(scene), after, beside + 100) == 0
