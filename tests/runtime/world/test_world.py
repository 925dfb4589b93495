"""A world at run time: light across borders, and sectors that come and go."""

import time
from pathlib import Path

import gsgi_files
import numpy as np
import pytest
import worlds

from gsgi.runtime.errors import FileError, FormatError
from gsgi.runtime.sampling import sample
from gsgi.runtime.world.world import FADE, STEP_MOST, World

MIDDLE = np.array([3.0, 1, 1])
FRAME = 1 / 60


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return worlds.random_world(tmp_path_factory.mktemp("world"), 3, 1, 2)


def points(count: int, low, high, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(low, high, (count, 3)), rng.normal(size=(count, 3))


def settled(path: Path, **options) -> World:
    world = World(path, **options)
    world.settle()
    return world


def passing(world: World, eye: np.ndarray, seconds: float) -> None:
    """Let time pass in frames, and wait for what is being read."""
    for _ in range(round(seconds / FRAME)):
        world.update(eye, FRAME)
        while world._loader.busy and world._loader._done.empty():
            time.sleep(0.001)


def test_away_from_borders_a_sector_has_the_light_of_its_file_to_the_bit(path):
    with settled(path) as world:
        for number, box in enumerate(worlds.cells(3, 1, 2)):
            where = points(300, box[0] + worlds.MARGIN, box[1] - worlds.MARGIN)
            np.testing.assert_array_equal(world.sample(*where), sample(world.manifest.read(number), *where))
            free = sample(world.manifest.read(number), *where, free=True)
            np.testing.assert_array_equal(world.sample(*where, free=True), free)


def test_light_has_no_seam_at_borders(path):
    """Neighbours differ by a factor here."""
    with settled(path) as world:
        position, normal = points(2000, 0, [6, 2, 4])
        for axis, border in ((0, 2.0), (0, 4.0), (2, 2.0), (0, 2 - worlds.MARGIN), (2, 2 + worlds.MARGIN)):
            sides = []
            for side in (-1, 1):
                position[:, axis] = border + side * 1e-6
                sides.append(world.sample(position, normal))
            assert sides[0].max() > 0.3
            assert np.abs(sides[1] - sides[0]).max() < 0.1 / 255


def test_within_a_border_light_lies_between_that_of_both_sectors(tmp_path):
    bakes = [gsgi_files.constant((light,) * 3) for light in (1.0, 2.0)]
    with settled(worlds.write(tmp_path, bakes, worlds.cells(2, 1, 1))) as world:
        x = np.linspace(1, 3, 65)
        light = world.sample(np.stack([x, x * 0 + 1, x * 0 + 1], axis=1), np.tile([0.0, 1, 0], (65, 1)))[:, 0]
        own = [sample(bake.read(n), [[1, 1, 1]], [[0, 1, 0]])[0, 0] for n, bake in enumerate([world.manifest] * 2)]
        across = np.clip((x - 2) / (2 * worlds.MARGIN) + 0.5, 0, 1)
        np.testing.assert_allclose(light, own[0] + across * (own[1] - own[0]), rtol=0.02)


def test_across_a_border_light_changes_evenly_whatever_the_weights_are(tmp_path):
    """Sums of both sectors, divided once, would jump where one weighs a thousand times as much as the other."""
    boxes = worlds.cells(2, 1, 1)
    bakes = [worlds.in_box(boxes[0], seed=1), gsgi_files.constant((3.0,) * 3)]
    faint = [worlds.replace(level, opacity=level.opacity / 500) for level in (bakes[0].gaussians, bakes[0].coarse)]
    bakes[0] = worlds.replace(bakes[0], gaussians=faint[0], coarse=faint[1])
    with settled(worlds.write(tmp_path, bakes, boxes)) as world:
        x = np.linspace(2 - worlds.MARGIN, 2 + worlds.MARGIN, 501)
        line, up = np.stack([x, x * 0 + 1, x * 0 + 1], axis=1), np.tile([0.0, 1, 0], (501, 1))
        own = [sample(world.manifest.read(number), line, up) for number in (0, 1)]
        share = np.linspace(0, 1, 501)[:, None]
        np.testing.assert_allclose(world.sample(line, up), (1 - share) * own[0] + share * own[1], rtol=1e-3, atol=1e-4)


def test_a_world_of_one_sector_is_its_file(tmp_path):
    bake = worlds.in_box(worlds.cells(1, 1, 1)[0], seed=4)
    with settled(worlds.write(tmp_path, [bake], worlds.cells(1, 1, 1))) as world:
        where = points(500, -3, 5)
        np.testing.assert_array_equal(world.sample(*where), sample(bake, *where))


def test_without_a_sector_there_is_no_light(path):
    world = World(path)
    where = points(20, 0, 2)
    assert not world.sample(*where).any()
    world.settle()
    world.close()
    world.close()
    assert not world.resident
    assert not world.sample(*where).any()


def test_sectors_come_around_the_eye_within_the_budget_and_go(path):
    memory = max(sector.memory for sector in World(path).manifest.sectors)
    with World(path, budget=2 * memory) as world:
        for eye, near in ((np.array([1.0, 1, 1]), 0), (np.array([5.0, 1, 3.5]), 5)):
            for _ in range(6):
                passing(world, eye, FADE)
                assert world.memory <= world.budget
            assert len(world.resident) == 2
            assert world.resident[near].weight == 1


def test_light_comes_in_steps_that_do_not_show(path):
    """Of a pixel that is white, its sRGB value."""
    with World(path, fade=0.05) as world:
        weights = [0.0]
        while weights[-1] < 1:
            world.update(MIDDLE, 0.1)
            weights.append(max([sector.weight for sector in world.resident.values()], default=0.0))
        linear = np.array(weights)
        srgb = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        assert np.diff(srgb).max() < 4 / 255
        assert len(set(weights)) == pytest.approx(1 / STEP_MOST, abs=2)


def test_a_frame_is_not_held_up_by_a_file(path, monkeypatch):
    with World(path) as world:
        read = type(world.manifest).read
        monkeypatch.setattr(type(world.manifest), "read", lambda *args: time.sleep(0.2) or read(*args))
        start = time.perf_counter()
        world.update(MIDDLE, FRAME)
        world.update(MIDDLE, FRAME)
        assert time.perf_counter() - start < 0.1
        passing(world, MIDDLE, 2 * FRAME)
        assert world.resident


def test_a_broken_sector_is_told_once_and_the_others_go_on(tmp_path):
    path = worlds.random_world(tmp_path, 2, 1, 1)
    with World(path) as world:
        (tmp_path / world.manifest.sectors[0].file).unlink()
        eye = np.array([0.5, 1, 1])
        with pytest.raises(FileError, match="cannot read"):
            passing(world, eye, 1)
        passing(world, eye, 3)
        assert list(world.resident) == [1]


def test_all_sectors_are_read_in_the_same_way(tmp_path):
    boxes = worlds.cells(2, 1, 1)
    bakes = [worlds.in_box(box, 1) for box in boxes]
    other = type(bakes[1].blend)(floor=0.25)
    bakes[1] = worlds.replace(bakes[1], blend=other)
    with pytest.raises(FormatError, match=r"level.1-.*: expected the blend of other sectors, .*, got .*floor=0.25"):
        settled(worlds.write(tmp_path, bakes, boxes))


def test_a_budget_holds_at_least_every_single_sector(path):
    with pytest.raises(ValueError, match=r"budget: expected at least \d+ bytes for level.*gsgi, got 10"):
        World(path, budget=10)


def test_what_a_sector_reaches_is_a_box_around_all_its_light(path):
    with settled(path) as world:
        for sector in world.resident.values():
            low, high = sector.reached
            inside = points(2000, low, high)
            assert sector.sampler.sample(*inside).any()
            beyond = high - low
            away = points(4000, low - beyond, high + beyond)
            outside = ((away[0] < low) | (away[0] > high)).any(axis=1)
            assert not sector.sampler.sample(away[0][outside], away[1][outside]).any()


@pytest.mark.parametrize("eye", [None, [0, 0], [0, np.nan, 0], [0, 0, np.inf], "abc"])
def test_an_eye_that_is_no_place_is_refused(path, eye):
    with World(path) as world:
        with pytest.raises(ValueError, match=r"^eye: expected three finite numbers"):
            world.update(eye, FRAME)
        if eye is not None:
            with pytest.raises(ValueError, match=r"^eye: "):
                world.settle(eye)


@pytest.mark.parametrize("seconds", [-FRAME, np.nan, -np.inf])
def test_time_passes(path, seconds):
    with settled(path) as world:
        before = world.sample(MIDDLE[None], np.float32([[0, 1, 0]]))
        with pytest.raises(ValueError, match=r"^seconds: expected a number from 0 on"):
            world.update(MIDDLE, seconds)
        world.update(MIDDLE, np.inf)
        np.testing.assert_array_equal(world.sample(MIDDLE[None], np.float32([[0, 1, 0]])), before)
