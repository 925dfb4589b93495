"""Worlds in C against Python's: what is refused, which sectors come and go, and their light at points and in frames."""

import ctypes
import time
from dataclasses import replace
from pathlib import Path

import gsgi_files
import numpy as np
import pytest
import worlds
from c_library import (
    CONTEXT_LOST,
    INVALID_ARGUMENT,
    INVALID_FILE,
    OK,
    OUT_OF_MEMORY,
    Budget,
    Context,
    Light,
    World,
    WorldOptions,
)
from c_light import SURFACE, WHOLE, texels
from gl_objects import alive
from host import CAMERA, SIZE, Host, projection, texture
from surface_cases import grouped, with_relief

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Effects
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight
from gsgi.runtime.world import manifest
from gsgi.runtime.world.world import World as PythonWorld

FRAME = 1 / 60
BOXES = worlds.cells(2, 2, 2, edge=1) - 1  # they meet in the middle of the host's room


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return worlds.random_world(tmp_path_factory.mktemp("world"), 3, 1, 2)


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    bakes = [worlds.in_box(box, seed) for seed, box in enumerate(BOXES)]
    return worlds.write(tmp_path_factory.mktemp("room"), bakes, BOXES)


def points(count: int, low, high, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(low, high, (count, 3)).astype(np.float32), rng.normal(size=(count, 3)).astype(np.float32)


def updated(world: PythonWorld, eye, seconds: float) -> None:
    """An update after which the thread has read what was asked for, as C's tests read it at once."""
    world.update(np.asarray(eye, np.float32), seconds)
    while world._loader.busy and world._loader._done.empty():
        time.sleep(0.001)


# ---- Manifests ----


def refusals(library, path: Path, data: bytes, monkeypatch) -> tuple[str | None, str | None]:
    """What Python and what C say of a manifest, whose files nobody looks at."""
    world = World(library, path, data)
    assert world.result in (OK, INVALID_FILE)
    assert len(world.messages) == (world.result == INVALID_FILE)
    world.close()
    monkeypatch.setattr(manifest, "_check_file", lambda *_: None)
    path.write_bytes(data)
    try:
        manifest.read_manifest(path)
    except FormatError as error:
        return str(error).removeprefix(f"{path}: "), world.messages[0] if world.messages else None
    return None, world.messages[0] if world.messages else None


def test_a_manifest_says_the_same_to_c_as_to_python(library, path):
    world, expected = World(library, path), manifest.read_manifest(path)
    info = world.info
    assert (info.scene, info.effects, info.margin) == (expected.scene, expected.effects, expected.margin)
    assert (info.sector_count, info.resident_count, info.memory, info.budget) == (6, 0, 0, 256 << 20)
    for number, sector in enumerate(expected.sectors):
        found = world.sector(number)
        assert (found.file.decode(), found.bytes, found.memory) == (sector.file, sector.bytes, sector.memory)
        assert (tuple(found.low), tuple(found.high)) == (sector.low, sector.high)
        assert (found.bake, found.weight) == (None, 0)
    world.close()


LIES = {name: lie for name, lie in worlds.LIES.items() if name not in ("a file elsewhere", "another size")}


@pytest.mark.parametrize("change", [lie[0] for lie in LIES.values()], ids=LIES)
def test_a_manifest_that_lies_is_refused_as_python_refuses_it(library, tmp_path, monkeypatch, change):
    path = worlds.write(tmp_path, [gsgi_files.constant((n + 1.0,) * 3) for n in range(3)], worlds.cells(3, 1, 1))
    python, c = refusals(library, path, worlds.changed(path, change).read_bytes(), monkeypatch)
    assert python.split("expected ")[0] == c.split("expected ")[0]
    assert len(c) < 300


@pytest.mark.parametrize(
    "name", ["../a.gsgi", "/a.gsgi", "a/../b.gsgi", "a//b", ".", "", "c:a", "a\\b.gsgi", "a\n", "x" * 256, "\ud800"]
)
def test_no_name_leads_out_of_the_folder(library, tmp_path, name):
    path = worlds.random_world(tmp_path, 1, 1, 1)
    world = World(library, worlds.changed(path, worlds.sector(0, file=name)))
    assert world.result == INVALID_FILE
    assert world.messages[0].startswith("sectors[0].file: expected ")


def test_names_may_have_letters_of_any_script_and_numbers_any_form(library, tmp_path):
    path = worlds.random_world(tmp_path, 1, 1, 1)
    name = "Höhle/\u6d1e\u7a74 \U0001f573.gsgi"
    text = worlds.changed(path, worlds.sector(0, file=name)).read_text()
    raw = text.replace(text.split('"file": "')[1].split('"')[0], name)
    assert "\\u" in text
    assert "\\u" not in raw
    for given in (text, raw):
        numbers = given.replace("[2.0, 2.0, 2.0]", "[0.30000000000000004, 2e+0, 20000000000000000000E-19]")
        world = World(library, path, numbers.encode())
        assert (world.result, world.sector(0).file.decode()) == (OK, name)
        assert list(world.sector(0).high) == [0.30000000000000004, 2, 2]
        world.close()


def test_a_member_that_is_there_twice_is_refused(library, path):
    for text in (b'"margin": 0.25,', b'"file": "level.0'):
        data = path.read_bytes().replace(text, text.split(b":")[0] + b": 1, " + text, 1)
        world = World(library, path, data)
        assert world.result == INVALID_FILE
        assert "expected one such member, got " in world.messages[0]


def damaged(path: Path, count: int, seed: int = 5) -> list[bytes]:
    """A manifest, cut off, with single bytes changed, and too deep."""
    data, rng = path.read_bytes(), np.random.default_rng(seed)
    cases = [data[:end] for end in range(0, len(data) - 1, 7)] + [data + b"x", b"\xef\xbb" + data, b"[" * 40]
    for _ in range(count):
        case = bytearray(data)
        for at in rng.integers(len(data), size=rng.integers(1, 4)):
            case[at] = rng.choice(list(b'0x"[]{},-.eE9\xff\n'))
        cases.append(bytes(case))
    return cases


def test_no_damage_is_read_otherwise_than_python_reads_it(library, tmp_path, monkeypatch):
    """Of single bytes, and of values in place of others."""
    path = worlds.random_world(tmp_path, 3, 1, 1)
    refused = []
    for case in damaged(path, 1500):
        python, c = refusals(library, path, case, monkeypatch)
        assert (python is None) == (c is None), (python, c)
        refused.append(c is not None)
    assert 0.3 < np.mean(refused) < 0.99


def test_sanitizers_find_nothing_in_damaged_manifests(sanitized, tmp_path):
    path = worlds.random_world(tmp_path, 2, 1, 2)
    corpus = damaged(path, 20000, seed=6)
    escapes = rb"\ud800", rb"\ud83d\udd73", rb"\ud83d\u0041", rb"\u12", b"\\", b"\xf0\x9f", b"\xc0\x80", rb"\u0000"
    name = path.read_bytes().split(b'"file": "')[1].split(b'"')[0]
    corpus += [path.read_bytes().replace(name, prefix + escape) for escape in escapes for prefix in (b"", b"a" * 250)]
    numbers = b"1e999999999", b"1" * 48, b"1" * 5000, b"-", b"0." + b"0" * 40 + b"1", b"1e-999", b"01", b"2.", b"1E+"
    corpus += [path.read_bytes().replace(b"2.0", number, 1) for number in numbers]
    corpus += b'|  |"|{|[|0|{"|{"a"|{"a":|[[|"\\|"\\u|tru|-1e|{}|[]'.split(b"|")
    opened = sanitized("world", corpus)
    assert 200 < opened < len(corpus) - 200


def test_a_budget_holds_at_least_every_single_sector(library, path):
    world = World(library, path, budget=10)
    assert world.result == INVALID_ARGUMENT
    assert world.messages[0].startswith("budget: expected at least ")
    assert World(library, path, fade=-1.0).result == INVALID_ARGUMENT


def test_without_memory_a_world_says_so_and_keeps_none(library, path):
    data, results = path.read_bytes(), []
    for count in range(6):
        budget, handle = Budget(count), ctypes.c_void_p()
        options = WorldOptions(callbacks=budget.callbacks)
        arguments = data, ctypes.c_size_t(len(data)), ctypes.byref(options), ctypes.byref(handle)
        results.append(library.functions.gsgi_world_open(*arguments))
        if results[-1] == OK:
            library.functions.gsgi_world_close(handle)
        assert not budget.blocks
    assert results == [OUT_OF_MEMORY] * 4 + [OK] * 2


# ---- Sectors come and go ----


def test_the_same_sectors_come_and_go_as_in_python_with_the_same_weights(library, path):
    memory = max(sector.memory for sector in manifest.read_manifest(path).sectors)
    flight = np.concatenate([np.linspace([0.5, 1, 1], [5.5, 1, 3.5], 400), np.tile([5.5, 1, 3.5], (150, 1))])
    world, where, seen = World(library, path, budget=3 * memory, fade=0.9), points(50, 0, [6, 2, 4]), set()
    with PythonWorld(path, budget=3 * memory, fade=float(np.float32(0.9))) as python:
        for number, eye in enumerate(flight):
            updated(python, eye, FRAME)
            world.step(eye, FRAME)
            # what was read in this update: Python adds it in the next one
            weights = {n: sector.weight for n, sector in python.resident.items()}
            found = {n: weight for n, weight in world.weights.items() if n in weights or weight}
            assert found == pytest.approx(weights, abs=1e-6)
            assert world.info.memory <= world.info.budget
            assert (world.info.changing != 0) == python.changing
            seen |= set(weights)
            if number % 40 == 0:
                np.testing.assert_allclose(world.sample(*where), python.sample(*where), rtol=1e-5, atol=1e-6)
                free = python.sample(*where, free=True)
                np.testing.assert_allclose(world.sample_free(*where), free, rtol=1e-5, atol=1e-6)
    assert seen == set(range(6))
    assert world.info.changing == 0
    world.close()


def test_infinite_time_lets_all_light_change_at_once(library, path):
    world = World(library, path)
    world.settle([1, 1, 1])
    assert world.weights == dict.fromkeys(range(6), 1)
    memory = max(sector.memory for sector in manifest.read_manifest(path).sectors)
    small = World(library, path, budget=memory)
    for eye, number in (([1, 1, 1], 0), ([5, 1, 3.5], 5)):
        small.settle(eye)
        assert small.weights == {number: 1}
    world.close()
    small.close()


def test_one_sector_is_asked_for_at_a_time_and_one_that_fails_no_more(library, path):
    world, eye = World(library, path), [0.5, 1, 1]
    assert world.update(eye, FRAME) == 0
    assert world.update(eye, FRAME) == -1
    assert world.add(3, None) == INVALID_ARGUMENT
    assert world.messages[-1] == "number: sector 3 was not asked for"
    for lists in (False, True):
        bake = library.opened((path.parent / world.sector(0).file.decode()).read_bytes(), lists=lists)
        assert world.add(0, bake) == INVALID_ARGUMENT
        assert world.messages[-1] == "bake: not one that gsgi_world_open_sector gave"
        library.close(bake)
    assert world.add(9, None) == INVALID_ARGUMENT
    assert world.add(0, None) == OK
    world.settle(eye)
    assert sorted(world.weights) == [1, 2, 3, 4, 5]
    world.close()


def test_only_the_file_that_the_manifest_describes_is_a_sector(library, path):
    world = World(library, path)
    name = path.parent / world.sector(0).file.decode()
    data = name.read_bytes()
    for other, field in ((data[:-1], "bytes"), (data[:-1] + bytes([data[-1] ^ 1]), "sha256"), (b"", "bytes")):
        assert world.open(0, other)[0] == INVALID_FILE
        assert world.messages[-1].startswith(f"{name.name}: {field}: expected ")
    assert world.open(17, data)[0] == INVALID_ARGUMENT
    world.close()


@pytest.mark.parametrize("length", [0, 1, 55, 56, 63, 64, 65, 119, 120, 1000])
def test_hashes_are_those_of_hashlib(library, tmp_path, length):
    """Of files of all lengths, which are then no .gsgi files."""
    path = worlds.random_world(tmp_path, 1, 1, 1)
    data = bytes(np.random.default_rng(length).integers(0, 256, length, np.uint8))
    digest = worlds.hashlib.sha256(data).hexdigest()
    world = World(library, worlds.changed(path, worlds.sector(0, sha256=digest, bytes=length)))
    assert world.open(0, data)[0] == INVALID_FILE
    assert world.messages[-1].startswith("byte ")
    world.close()


def test_a_sector_has_the_operator_and_the_memory_of_the_manifest(library, tmp_path):
    path = worlds.random_world(tmp_path, 1, 1, 1)
    world = World(library, worlds.changed(path, worlds.sector(0, memory=5)))
    assert world.open(0)[0] == INVALID_FILE
    assert "memory: expected 5, as the manifest says, got " in world.messages[-1]
    world.close()
    data = (gsgi_files.DATA / "v6_over.gsgi").read_bytes()
    digest = worlds.hashlib.sha256(data).hexdigest()
    world = World(library, worlds.changed(path, worlds.sector(0, sha256=digest, bytes=len(data))))
    assert world.open(0, data)[0] == INVALID_FILE
    assert "operator: expected surface" in world.messages[-1]
    world.close()


def test_all_sectors_are_read_in_the_same_way(library, tmp_path):
    boxes = worlds.cells(2, 1, 1)
    bakes = [worlds.in_box(box, 1) for box in boxes]
    bakes[1] = replace(bakes[1], blend=replace(bakes[1].blend, floor=0.25))
    world = World(library, worlds.write(tmp_path, bakes, boxes))
    assert world.step([0, 0, 0], FRAME) == 0
    assert world.update([0, 0, 0], FRAME) == 1
    result, bake = world.open(1)
    assert (result, world.add(1, bake)) == (OK, INVALID_FILE)
    assert world.messages[-1].endswith("expected the blend of other sectors")
    library.close(bake)
    assert world.add(1, None) == OK
    assert world.update([0, 0, 0], FRAME) == -1
    world.close()


def test_an_eye_that_is_nowhere_and_time_that_goes_back_are_refused(library, path):
    world, load = World(library, path), ctypes.c_int32()
    for eye, seconds in (([np.nan, 0, 0], 1), ([0, np.inf, 0], 1), ([0, 0, 0], -1), ([0, 0, 0], np.nan)):
        arguments = (ctypes.c_float * 3)(*eye), ctypes.c_double(seconds), ctypes.byref(load)
        assert library.functions.gsgi_world_update(world.handle, *arguments) == INVALID_ARGUMENT
    world.close()


# ---- Light ----


def test_away_from_borders_a_sector_has_the_light_of_its_file_to_the_bit(library, path):
    world = World(library, path)
    world.settle([3, 1, 1])
    for number, box in enumerate(worlds.cells(3, 1, 2)):
        where = points(300, box[0] + worlds.MARGIN, box[1] - worlds.MARGIN)
        result, bake = world.open(number)
        assert result == OK
        np.testing.assert_array_equal(world.sample(*where), library.sample(bake, *where))
        library.close(bake)
    world.close()


def test_sectors_behind_gaps_have_their_own_light_alone_as_in_python(library, tmp_path):
    boxes = worlds.cells(6, 1, 3)[[0, 1, 4, 8, 17]]
    path = worlds.write(tmp_path, [worlds.in_box(box, seed) for seed, box in enumerate(boxes)], boxes)
    world, python = World(library, path), PythonWorld(path)
    world.settle([6, 1, 3])
    python.settle(np.array([6.0, 1, 3]))
    for number in (0, 1, 4):  # the others touch along an edge
        where = points(300, boxes[number, 0] + worlds.MARGIN, boxes[number, 1] - worlds.MARGIN)
        result, bake = world.open(number)
        assert result == OK
        np.testing.assert_array_equal(world.sample(*where), library.sample(bake, *where))
        library.close(bake)
    where = points(2000, -1, [13, 3, 7])
    np.testing.assert_allclose(world.sample(*where), python.sample(*where), rtol=1e-5, atol=1e-6)
    python.close()
    world.close()


def test_points_that_are_no_numbers_have_no_light(library, path):
    world = World(library, path)
    world.settle([3, 1, 1])
    position, normal = points(5, 0, [6, 2, 4])
    position[0, 1], position[1, 2], position[2, 0] = np.nan, np.inf, 3e38
    normal[3], normal[4] = np.nan, 0
    assert not world.sample(position, normal).any()
    world.close()


def drawn(gl, light: Light, world: World, textures, mapped=None) -> np.ndarray:
    """What the light shows of a world: (H, W, 4) float32, as integers."""
    gl.error  # noqa: B018  reading it clears what Python's pass left
    assert light.follow(world) == OK, light.context.messages
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    result, name = light.draw(*(made.glo for made in (*textures, *([mapped] if mapped else []))))
    assert result == OK, light.context.messages
    assert gl.error == "GL_NO_ERROR"
    return texels(name, gl, SIZE)


def check_frames(gl, library, context, host, path, frames, mapped=None, **options) -> None:
    """The same pixels as Python's, while sectors come in."""
    textures = host.textures(gl, Encoding())
    world, means = World(library, path, fade=0.3), []
    light = Light(context, world, Encoding(), relief=mapped is not None, **options)
    assert light.result == OK, context.messages
    with PythonWorld(path, fade=float(np.float32(0.3))) as python:
        other = IndirectLight(gl, python, Encoding(), **options)
        for number in range(max(frames) + 1):
            updated(python, [0, 0, 0], FRAME)
            world.step([0, 0, 0], FRAME)
            if number not in frames:
                continue
            matrices = np.float32(CAMERA.view_from_world), np.float32(projection())
            made = other.draw(*textures, *matrices, WHOLE, mapped)
            expected, found = texels(made.glo, gl, SIZE), drawn(gl, light, world, textures, mapped)
            means.append(expected.view(np.float32)[..., :3].mean())
            if "llvmpipe" in gl.info["GL_RENDERER"]:
                np.testing.assert_array_equal(found, expected)
            else:
                np.testing.assert_allclose(found.view(np.float32), expected.view(np.float32), atol=2e-3, rtol=2e-3)
        other.release()
    assert (np.diff(means) > 0).all()
    light.destroy()
    world.close()


@pytest.mark.parametrize("splat_scale", [1, 2])
def test_pixels_are_those_of_python_while_sectors_come(gl, library, context, host, room, splat_scale):
    check_frames(gl, library, context, host, room, (0, 30, 50, 95), splat_scale=splat_scale)


def test_so_they_are_with_light_that_follows_normal_maps(gl, library, context, host, tmp_path):
    """In some sectors: the others have none."""
    bakes = [worlds.in_box(box, seed) for seed, box in enumerate(BOXES)]
    bakes[::2] = [codec.decode(codec.encode(with_relief(bake))) for bake in bakes[::2]]
    path = worlds.write(tmp_path, bakes, BOXES, effects=Effects.NORMAL_MAP)
    bent = host.normal + np.random.default_rng(0).uniform(-0.5, 0.5, host.normal.shape)
    mapped = texture(gl, np.concatenate([bent, bent[..., :1]], axis=-1))
    check_frames(gl, library, context, host, path, (40, 95), mapped)


def test_a_box_is_all_that_is_lit(gl, library, context, host, room):
    box = np.array([[-9, -9, -9], [0, 9, 9]])
    check_frames(gl, library, context, host, room, (95,), box=box)


def test_a_sector_has_the_light_of_its_weights(gl, library, context, host, tmp_path):
    box = worlds.cells(1, 1, 1) - 1
    path, images = worlds.write(tmp_path, [grouped(worlds.in_box(box[0], 1))], box), []
    for weight in (0.5, 0.25):
        world = World(library, path)
        light = Light(context, world, Encoding())
        assert world.update([0, 0, 0], np.inf) == 0
        result, bake = world.open(0)
        assert (result, library.weigh(bake, dict.fromkeys(library.group_names(bake), (weight,) * 3))) == (OK, OK)
        assert world.add(0, bake) == OK
        world.settle([0, 0, 0])
        images.append(drawn(gl, light, world, host.textures(gl, Encoding())).view(np.float32)[..., :3])
        light.destroy()
        world.close()
    assert images[0].max() > 0.1
    np.testing.assert_allclose(images[1], 0.5 * images[0], rtol=1e-3, atol=1e-6)


def test_far_from_the_origin_a_world_is_as_precise(gl, library, context, host, tmp_path, room):
    far, images = np.array([60000.0, 0, 0]), []
    bakes = [worlds.in_box(box, seed) for seed, box in enumerate(BOXES)]
    for bake in bakes:
        for level in (bake.gaussians, bake.coarse):
            level.position[...] += np.float32(far)
    textures = host.textures(gl, Encoding())
    for path, shift in ((room, 0 * far), (worlds.write(tmp_path, bakes, BOXES + far), far)):
        world = World(library, path)
        light = Light(context, world, Encoding(), splat_scale=1)
        world.settle(shift)
        pose = CAMERA.view_from_world.copy()
        pose[:3, 3] -= pose[:3, :3] @ shift
        assert light.follow(world) == OK
        assert light.cull(pose, projection(), WHOLE) == OK
        images.append(texels(light.draw(*(made.glo for made in textures))[1], gl, SIZE).view(np.float32)[..., :3])
        light.destroy()
        world.close()
    assert images[0].max() > 0.3
    assert np.abs(images[1] - images[0]).mean() < 0.02 * images[0].mean()


def test_a_light_keeps_what_it_has_followed_and_leaves_nothing_behind(fresh_gl, library, room):
    textures = Host(fresh_gl).textures(fresh_gl, Encoding())
    before = alive(fresh_gl)
    context, world = Context(library, fresh_gl), World(library, room)
    light = Light(context, world, Encoding())
    assert not drawn(fresh_gl, light, world, textures).view(np.float32)[..., :3].any()
    empty = alive(fresh_gl)
    world.settle([0, 0, 0])
    lit = drawn(fresh_gl, light, world, textures)
    assert lit.view(np.float32)[..., :3].any()
    assert light.stats().gaussian_bytes > 8 * 32768
    assert sum(light.stats().drawn) > 100
    world.close()
    assert light.cull(CAMERA.view_from_world, projection(), WHOLE) == OK
    name = light.draw(*(made.glo for made in textures))[1]
    np.testing.assert_array_equal(texels(name, fresh_gl, SIZE), lit)

    gone = World(library, room)  # as of another level: nothing is in memory
    assert not drawn(fresh_gl, light, gone, textures).view(np.float32)[..., :3].any()
    gone.close()
    left = alive(fresh_gl)
    assert left == {**empty, "Program": left["Program"]}
    light.destroy()
    context.destroy()
    assert alive(fresh_gl) == before


def test_what_has_no_sectors_follows_none(gl, library, context, room):
    world, light = World(library, room), Light(context, SURFACE, Encoding())
    assert light.follow(world) == INVALID_ARGUMENT
    assert context.messages[-1] == "light: it was not made of a world"
    light.destroy()
    light = Light(context, world, Encoding())
    bake = library.opened(SURFACE)
    assert light.recolour(bake) == INVALID_ARGUMENT
    library.close(bake)
    light.destroy()
    world.close()


def test_after_a_lost_context_no_sector_is_uploaded(fresh_gl, library, room):
    context, world = Context(library, fresh_gl), World(library, room)
    light = Light(context, world, Encoding())
    world.settle([0, 0, 0])
    library.functions.gsgi_context_forget(context.handle)
    assert light.follow(world) == CONTEXT_LOST
    assert Light(context, world, Encoding()).result == CONTEXT_LOST
    light.destroy()
    context.destroy()
    world.close()
