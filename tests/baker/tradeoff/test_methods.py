"""The methods: they converge to path tracing as their setting goes up, and their passes draw what they answer."""

import numpy as np
import pytest

from gsgi.baker.evaluation import held_out
from gsgi.baker.tradeoff import ambient, light_volume, lightmap, path_tracing, probes, radiosity, voxel_cones
from gsgi.baker.tradeoff.measure import free_error
from gsgi.baker.tradeoff.methods import METHODS
from gsgi.baker.tradeoff.study import MAGNIFIED

CONVERGING = lightmap.PLAIN, lightmap.DENOISED, probes.PLAIN, probes.VISIBLE, radiosity.METHOD
STORED = {method.name: method for method in (*CONVERGING, light_volume.METHOD, voxel_cones.METHOD)}
SETTINGS = {
    "lightmap": (6.0, 30.0),
    "lightmap-denoised": (6.0, 30.0),
    "probes": (2.0, 16.0),
    "probes-visibility": (2.0, 16.0),
    "radiosity": (128.0, 2048.0),
    "light-volume": (4.0, 6.0),
    "voxel-cones": (4.0, 10.0),
}


def error(ground, images) -> float:
    """Relative RMS error of B over all views, free of the references' noise."""
    squared, light = [], []
    for image, reference in zip(images, ground.references.values(), strict=True):
        a, b = (half[reference.valid].astype(float) for half in (reference.indirect_a, reference.indirect_b))
        squared.append(((image[reference.valid] - a) * (image[reference.valid] - b)).mean())
        light.append((a + b).mean() / 2)
    return float(np.sqrt(max(np.mean(squared), 0)) / np.mean(light))


def answered(ground, answer) -> list[np.ndarray]:
    """B in the views by the answer on the processor."""
    images = []
    for reference in ground.references.values():
        image = np.zeros((*reference.valid.shape, 3), np.float32)
        surface = reference.surface
        image[reference.valid] = answer.at(surface.position[reference.valid], surface.normal[reference.valid])
        images.append(image)
    return images


@pytest.mark.parametrize("name", [method.name for method in CONVERGING])
def test_a_method_converges_to_path_tracing(ground, name):
    coarse, fine = (error(ground, answered(ground, ground.bake(STORED[name], value)[0])) for value in SETTINGS[name])
    constant = error(ground, answered(ground, ground.bake(ambient.METHOD, 0.0)[0]))
    assert fine < coarse / 2
    assert fine < constant / 2
    assert fine < 0.08


def test_path_tracing_converges_with_its_paths(ground):
    few, many = (error(ground, ground.bake(path_tracing.PLAIN, value)[0].images) for value in (4.0, 256.0))
    assert many < few / 5  # as one over the root of their number: 8
    assert error(ground, ground.bake(path_tracing.DENOISED, 16.0)[0].images) < few / 2


@pytest.mark.parametrize("name", [*STORED, "ambient"])
def test_the_pass_draws_what_the_method_answers(gl, ground, name):
    from gsgi.baker.tradeoff.gl.frame import Frame

    method, value = (STORED[name], SETTINGS[name][1]) if name in STORED else (ambient.METHOD, 0.0)
    answer, _ = ground.bake(method, value)
    frame = Frame(gl, ground.scene, (MAGNIFIED * held_out.SIZE,) * 2)
    light = answer.light_pass(frame, 1)
    middle = slice(MAGNIFIED // 2, None, MAGNIFIED)
    for expected, (camera, reference) in zip(answered(ground, answer), ground.references.items(), strict=True):
        drawn = frame.indirect(ground.cameras[camera], light)[middle, middle]
        difference = np.abs(drawn - expected)[reference.valid].max(axis=1)
        # Where a pixel centre meets an edge, ray casting and rasterising may see different triangles.
        assert np.quantile(difference, 0.98) < 0.01 * ground.tone_scale
    light.release()
    frame.release()


def test_the_seconds_are_those_of_the_first_bake(ground):
    answer, seconds = ground.bake(lightmap.PLAIN, SETTINGS["lightmap"][0])
    again, the_same = ground.bake(lightmap.PLAIN, SETTINGS["lightmap"][0])
    assert seconds == the_same
    assert set(seconds) >= {"unwrap", "irradiance"}
    np.testing.assert_array_equal(answer.texels, again.texels)
    assert answer.file_bytes == answer.texels.size // 3 + 4 * len(answer.atlas.uv)


def test_probes_light_free_space_and_lightmaps_do_not(ground):
    grid, _ = ground.bake(probes.PLAIN, SETTINGS["probes"][1])
    constant, _ = ground.bake(ambient.METHOD, 0.0)
    assert free_error(grid, ground.free_light) < free_error(constant, ground.free_light) / 2
    assert not lightmap.PLAIN.in_space


def test_the_borders_of_octahedral_maps_continue_them():
    """A bilinear look-up of a linear function of the direction is smooth across the map's edge."""
    direction = probes._directions()
    tile = direction.reshape(1, 1, 1, probes.TILE, probes.TILE, 3)[..., :2].astype(np.float16)
    grid = probes.Probes(np.zeros(3), np.ones(3), np.zeros((1, 1, 1, 9, 3), np.float16), tile)
    around = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    for tilt in (-0.02, 0.02):  # both sides of the fold at z = 0 and of the outer edge's corners at z = -1
        looked = np.stack([np.cos(around), np.sin(around), np.full(64, tilt)], axis=1)
        looked /= np.linalg.norm(looked, axis=1, keepdims=True)
        np.testing.assert_allclose(grid._filtered(np.zeros((64, 3), int), looked), looked[:, :2], atol=0.06)
    below = np.array([[0.05, 0.03, -1.0], [-0.05, 0.03, -1.0], [0.03, -0.05, -1.0]])
    below /= np.linalg.norm(below, axis=1, keepdims=True)
    np.testing.assert_allclose(grid._filtered(np.zeros((3, 3), int), below), below[:, :2], atol=0.06)


def test_names_are_unique_and_say_how_each_is_built():
    assert len({method.name for method in METHODS}) == len(METHODS)
    assert all(method.title and method.built.endswith(".") for method in METHODS)
