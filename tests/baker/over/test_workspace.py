"""The fused iteration: a step equals autograd of the twin and Adam as published; who is not seen is left alone."""

import numpy as np
import oracle
import pytest
import scenes
import torch
import torch_splat

from gsgi.baker.native import kernels
from gsgi.baker.over.rasterise import rasterise, set_thread_count
from gsgi.baker.over.raw_gaussians import NAMES, RawGaussians
from gsgi.baker.over.workspace import AdamState, Workspace
from gsgi.runtime.gaussians import OverBlend

BLEND = OverBlend(near=0.01)
PINHOLE = scenes.inside_camera().pinhole(48, 40)
RATES = {"position": 0.01, "rotation": 0.02, "log_scale": 0.03, "logit_opacity": 0.04, "sh": 0.05}
BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-15

# Single precision against double, as in test_splat.py.
TOLERANCE = 1e-4


def random_raw(count: int = 50, degree: int = 0, seed: int = 20) -> RawGaussians:
    raw = RawGaussians.from_gaussians(oracle.random_gaussians(count, degree, seed))
    raw.rotation[:] *= np.linspace(0.5, 2, count, dtype=np.float32)[:, None]  # any length
    return raw


def by_image_of(pinhole=PINHOLE, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(pinhole.height, pinhole.width, 3)).astype(np.float32)


def twin(raw: RawGaussians, pinhole=PINHOLE) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
    """Raw parameters in double precision, and the image that they make."""
    p = {name: torch.tensor(getattr(raw, name), dtype=torch.float64, requires_grad=True) for name in NAMES}
    rotation = torch.nn.functional.normalize(p["rotation"], dim=1)
    activated = p["position"], rotation, p["log_scale"].exp(), p["logit_opacity"].sigmoid(), p["sh"]
    return p, torch_splat.splat(*activated, pinhole, BLEND)[0]


def twin_gradients(raw: RawGaussians, by_image: np.ndarray, pinhole=PINHOLE) -> dict[str, np.ndarray]:
    parameters, image = twin(raw, pinhole)
    image.backward(torch.from_numpy(by_image).double())
    return {name: parameter.grad.numpy() for name, parameter in parameters.items()}


def assert_close(actual, expected, message: str):
    np.testing.assert_allclose(actual, expected, TOLERANCE, TOLERANCE * np.abs(expected).max(), err_msg=message)


def copy(raw: RawGaussians) -> RawGaussians:
    return RawGaussians(*(getattr(raw, name).copy() for name in NAMES))


def bits(raw: RawGaussians, adam: AdamState) -> list[bytes]:
    return [getattr(group, name).tobytes() for group in (raw, adam.mean, adam.square) for name in NAMES]


def test_raw_gaussians_activate_to_what_they_were_made_of():
    gaussians = oracle.random_gaussians(50, 2, seed=1)
    again = RawGaussians.from_gaussians(gaussians).to_gaussians()
    for name in ("position", "rotation", "scale", "opacity", "sh"):
        # Logarithms and logits of floats: 1e-6, and opacity is cut at 1 - 1e-4.
        np.testing.assert_allclose(
            getattr(again, name), getattr(gaussians, name), rtol=2e-4 if name == "opacity" else 1e-5
        )


def test_the_image_of_raw_gaussians_is_that_of_activated_ones():
    raw = random_raw(degree=2)
    image, _ = Workspace().forward(raw, PINHOLE, BLEND)
    assert_close(image, rasterise(raw.to_gaussians(), PINHOLE, BLEND), "image")


@pytest.mark.parametrize("degree", range(4))
def test_a_step_has_the_gradients_of_the_twin(degree):
    raw, by_image = random_raw(degree=degree), by_image_of()
    adam, workspace = AdamState.zeros(raw), Workspace()
    expected = twin_gradients(raw, by_image)
    workspace.forward(raw, PINHOLE, BLEND)
    assert workspace.step(raw, adam, by_image, RATES).not_finite == -1
    for name, gradient in expected.items():
        assert_close(getattr(adam.mean, name), (1 - BETA1) * gradient, f"mean of {name}")
        assert_close(getattr(adam.square, name), (1 - BETA2) * gradient**2, f"square of {name}")


def test_steps_are_those_of_adam():
    """Kingma and Ba 2015, from the kernel's own gradients, which its first moments reveal."""
    raw, workspace = random_raw(degree=1), Workspace()
    adam = AdamState.zeros(raw)
    mean = {name: np.zeros(getattr(raw, name).shape) for name in NAMES}
    square = {name: np.zeros(getattr(raw, name).shape) for name in NAMES}
    for iteration in range(1, 4):
        before, old_mean = copy(raw), copy(adam.mean)
        workspace.forward(raw, PINHOLE, BLEND)
        workspace.step(raw, adam, by_image_of(seed=iteration), RATES)
        stepped = adam.steps == iteration
        assert stepped.sum() > 40
        for name in NAMES:
            gradient = (getattr(adam.mean, name) - BETA1 * getattr(old_mean, name).astype(float)) / (1 - BETA1)
            mean[name] = BETA1 * mean[name] + (1 - BETA1) * gradient
            square[name] = BETA2 * square[name] + (1 - BETA2) * gradient**2
            root = np.sqrt(square[name] / (1 - BETA2**iteration)) + EPSILON
            expected = getattr(before, name) - RATES[name] * mean[name] / (1 - BETA1**iteration) / root
            # The gradient comes out of a difference of floats: some 1e-6 of the mean, more where it nearly cancels.
            actual = getattr(raw, name)
            np.testing.assert_allclose(actual[stepped], expected[stepped], rtol=1e-5, atol=1e-4 * RATES[name])


def test_the_first_step_is_the_rate_and_late_comers_start_like_the_others():
    raw, by_image = random_raw(), by_image_of()
    adam, workspace = AdamState.zeros(raw), Workspace()
    adam.steps[:25] = 1000  # these have been seen before, with gradients of zero
    before = copy(raw)
    workspace.forward(raw, PINHOLE, BLEND)
    workspace.step(raw, adam, by_image, RATES)
    moved = np.abs(raw.sh - before.sh)[:, 0].max(axis=1)
    late = moved[25:][adam.steps[25:] == 1]
    assert len(late) > 10
    np.testing.assert_allclose(late, RATES["sh"], rtol=1e-4)
    seen = adam.steps[:25] == 1001
    # m = 0.1 g and sqrt(s) = sqrt(0.001) |g|, corrected for 1001 steps.
    ratio = 0.1 / np.sqrt(0.001 / (1 - BETA2**1001))
    np.testing.assert_allclose(moved[:25][seen], RATES["sh"] * ratio, rtol=1e-4)


def test_who_is_not_seen_keeps_its_bits():
    raw = random_raw()
    raw.position[::2] += 100 * scenes.inside_camera().world_from_view[:3, 2].astype(np.float32)  # behind the eye
    before, adam, workspace = copy(raw), AdamState.zeros(raw), Workspace()
    workspace.forward(raw, PINHOLE, BLEND)
    found = workspace.step(raw, adam, by_image_of(), RATES)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(raw, name)[::2], getattr(before, name)[::2])
        assert not getattr(adam.mean, name)[::2].any()
    assert not adam.steps[::2].any()
    assert not any(statistic[::2].any() for statistic in found[:4])
    assert (adam.steps[1::2] == 1).sum() > 20


def test_no_gradient_no_step():
    raw = random_raw()
    before, adam, workspace = copy(raw), AdamState.zeros(raw), Workspace()
    workspace.forward(raw, PINHOLE, BLEND)
    workspace.step(raw, adam, 0 * by_image_of(), RATES)
    assert bits(raw, adam) == bits(before, AdamState.zeros(raw))
    assert not adam.steps.any()


def test_statistics_equal_their_definition():
    raw, by_image = random_raw(), by_image_of()
    error = np.random.default_rng(8).uniform(size=(40, 48)).astype(np.float32)
    # The image is linear in the colours: its gradient by one is the sum of weights.
    weights = []
    for seen in (np.ones_like(error), error):
        parameters, image = twin(raw)
        (by_sh,) = torch.autograd.grad(
            image, [parameters["sh"]], torch.tensor(seen[..., None].repeat(3, axis=2)).double()
        )
        weights.append(by_sh[:, 0, 0].numpy() / 0.28209479177387814)
    workspace = Workspace()
    workspace.forward(raw, PINHOLE, BLEND)
    found = workspace.step(raw, AdamState.zeros(raw), by_image, RATES, error)
    assert_close(found.contribution, weights[0], "contribution")
    assert_close(found.error, weights[1], "error")
    projected = oracle.project(random_raw().to_gaussians(), PINHOLE, BLEND)
    radius = np.sqrt(np.linalg.eigvalsh(projected.cov2d)[:, 1])
    drawn = found.radius > 0
    assert drawn.sum() > 30
    assert_close(found.radius[drawn], radius[drawn], "radius")
    assert not found.contribution[~drawn].any()


def test_gradient_by_the_mean_equals_that_of_a_shifted_image():
    """With the eye far away and a long lens, moving the principal point moves all means alike."""
    raw = random_raw(count=1, seed=5)
    raw.position[:] = scenes.inside_camera().position - scenes.inside_camera().world_from_view[:3, 2]
    by_image = by_image_of()
    workspace = Workspace()
    workspace.forward(raw, PINHOLE, BLEND)
    found = workspace.step(copy(raw), AdamState.zeros(raw), by_image, RATES)
    step, expected = 1e-4, []
    for axis in ("cx", "cy"):
        images = [twin(raw, PINHOLE._replace(**{axis: getattr(PINHOLE, axis) + sign * step}))[1] for sign in (1, -1)]
        difference = (images[0] - images[1]).detach().numpy() / (2 * step)
        expected.append((difference * by_image).sum())
    # The step at alpha_min makes differences rough: 1/255 of a colour at the edge, against the whole inside.
    np.testing.assert_allclose(found.mean2d_gradient, np.hypot(*expected), rtol=0.02)


def train(count: int, pinhole, steps: int = 3) -> list[bytes]:
    raw = random_raw(count, degree=1)
    adam, workspace = AdamState.zeros(raw), Workspace()
    found = []
    for iteration in range(steps):
        image, transmittance = workspace.forward(raw, pinhole, BLEND)
        by_image = by_image_of(pinhole, seed=iteration)
        statistics = workspace.step(raw, adam, by_image, RATES, np.abs(by_image[..., 0]).copy())
        found += [image.tobytes(), transmittance.tobytes(), *(s.tobytes() for s in statistics[:4])]
    return found + bits(raw, adam) + [adam.steps.tobytes()]


def test_same_bits_for_any_number_of_threads():
    pinhole = scenes.inside_camera().pinhole(130, 90)
    results = []
    try:
        for threads in (1, 2, 7):
            set_thread_count(threads)
            results.append(train(3000, pinhole))
    finally:
        set_thread_count(0)
    assert results[0] == results[1] == results[2]


def test_same_bits_for_every_instruction_set():
    names = kernels.instruction_sets()
    if len(names) == 1:
        pytest.skip("this processor has one instruction set")
    results = []
    try:
        for name in names:
            kernels.set_instruction_set(name)
            results.append(train(300, scenes.inside_camera().pinhole(70, 50)))
    finally:
        kernels.set_instruction_set(names[-1])
    assert all(result == results[0] for result in results[1:])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_gradient_that_is_not_finite_is_named_and_nothing_is_stepped(value):
    raw = random_raw()
    before, adam, workspace = copy(raw), AdamState.zeros(raw), Workspace()
    workspace.forward(raw, PINHOLE, BLEND)
    by_image = by_image_of()
    by_image[20, 24] = value
    found = workspace.step(raw, adam, by_image, RATES)
    assert found.not_finite >= 0
    assert found.contribution[found.not_finite] > 0
    assert bits(raw, adam) == bits(before, AdamState.zeros(raw))


def test_a_forward_allows_one_step():
    raw, workspace = random_raw(), Workspace()
    adam = AdamState.zeros(raw)
    with pytest.raises(ValueError, match="one step"):
        workspace.step(raw, adam, by_image_of(), RATES)
    workspace.forward(raw, PINHOLE, BLEND)
    workspace.step(raw, adam, by_image_of(), RATES)
    with pytest.raises(ValueError, match="one step"):
        workspace.step(raw, adam, by_image_of(), RATES)


@pytest.mark.parametrize("name", NAMES)
def test_wrong_arrays_are_refused(name):
    good = random_raw()
    for wrong in (getattr(good, name).astype(np.float64), getattr(good, name)[:-1].copy()):
        arrays = {n: getattr(good, n) for n in NAMES} | {name: wrong}
        if wrong.dtype == np.float32 and name == "position":
            continue  # the first array says how many there are: the others are named
        with pytest.raises(TypeError, match=name):
            Workspace().forward(RawGaussians(**arrays), PINHOLE, BLEND)


def test_gradients_of_another_size_are_refused():
    raw, workspace = random_raw(), Workspace()
    adam = AdamState.zeros(raw)
    workspace.forward(raw, PINHOLE, BLEND)
    with pytest.raises(TypeError, match="size"):
        workspace.step(raw, adam, by_image_of()[1:].copy(), RATES)
    with pytest.raises(TypeError, match="size"):
        workspace.step(raw, adam, by_image_of(), RATES, np.zeros((3, 3), np.float32))


@pytest.mark.parametrize(
    ("growth", "size"), [(-2.0, 160), (1.0, 160), (1.0, 16)], ids=["small", "each on many tiles", "all on one tile"]
)
def test_memory_stays_within_the_budget(growth, size):
    count, pinhole = 20_000, scenes.inside_camera().pinhole(size, size)
    raw = random_raw(count)
    raw.log_scale[:] += growth
    adam, workspace = AdamState.zeros(raw), Workspace()
    image, transmittance = workspace.forward(raw, pinhole, BLEND)
    by_image = by_image_of(pinhole)
    statistics = workspace.step(raw, adam, by_image, RATES)
    arrays = [getattr(group, name) for group in (raw, adam.mean, adam.square) for name in NAMES]
    arrays += [adam.steps, image, transmittance, by_image, *statistics[:4]]
    total = workspace.byte_count + sum(a.nbytes for a in arrays)
    assert total <= 300 * count + 100 * size * size
    assert (statistics.radius > 0).mean() > 0.6  # met while most are drawn


def test_a_tile_with_more_gaussians_than_are_held_at_once_has_the_gradients_of_the_twin():
    camera = scenes.inside_camera()
    pinhole = camera.pinhole(48, 16)._replace(cx=40.0)  # the crowd is in the last tile
    raw, by_image = random_raw(1000), by_image_of(pinhole)
    depth = (camera.position - raw.position) @ camera.world_from_view[:3, 2]
    axis = camera.position - depth[:, None] * camera.world_from_view[:3, 2]
    raw.position[:] = axis + 0.2 * (raw.position - axis)
    raw.log_scale[:] -= 2
    raw.logit_opacity[:] -= 3
    adam, workspace = AdamState.zeros(raw), Workspace()
    expected = twin_gradients(raw, by_image, pinhole)
    workspace.forward(raw, pinhole, BLEND)
    found = workspace.step(raw, adam, by_image, RATES)
    assert (found.contribution > 0).sum() > 500  # far more than 1000 / 16 + 48 * 16 / 4
    for name, gradient in expected.items():
        assert_close(getattr(adam.mean, name), (1 - BETA1) * gradient, f"mean of {name}")


@pytest.mark.parametrize("count", [0, 1])
def test_almost_no_gaussians(count):
    raw, workspace = random_raw(count), Workspace()
    image, transmittance = workspace.forward(raw, PINHOLE, BLEND)
    assert image.shape == (40, 48, 3)
    found = workspace.step(raw, AdamState.zeros(raw), by_image_of(), RATES)
    assert found.not_finite == -1
    assert len(found.radius) == count
    assert (transmittance == 1).all() == (count == 0)


def test_a_workspace_serves_images_and_gaussians_of_any_size():
    workspace = Workspace()
    for count, size in ((200, 64), (50, 16), (400, 100)):
        raw, pinhole = random_raw(count), scenes.inside_camera().pinhole(size, size)
        image, _ = workspace.forward(raw, pinhole, BLEND)
        np.testing.assert_array_equal(image, Workspace().forward(raw, pinhole, BLEND)[0])


@pytest.mark.parametrize("degree", [0, 2])
def test_a_colour_that_is_not_a_number_shows_and_is_named(degree):
    """Not as black, nor as the least finite number."""
    raw = random_raw(degree=degree)
    drawn = Workspace()
    drawn.forward(raw, PINHOLE, BLEND)
    seen = int(drawn.step(copy(raw), AdamState.zeros(raw), by_image_of(), RATES).contribution.argmax())
    raw.sh[seen] = np.nan
    workspace, adam = Workspace(), AdamState.zeros(raw)
    image, _ = workspace.forward(raw, PINHOLE, BLEND)
    assert np.isnan(image).any()
    before = bits(raw, adam)
    assert workspace.step(raw, adam, by_image_of(), RATES).not_finite >= 0
    assert bits(raw, adam) == before


def test_a_gradient_that_is_no_number_though_its_sums_are_is_named_and_not_stepped():
    """The SH of band 1 are infinite where they add up to no light: 0 times infinity."""
    raw = random_raw(degree=1)
    drawn = Workspace()
    drawn.forward(raw, PINHOLE, BLEND)
    seen = int(drawn.step(copy(raw), AdamState.zeros(raw), by_image_of(), RATES).contribution.argmax())
    raw.sh[seen] = 0
    workspace, adam = Workspace(), AdamState.zeros(raw)
    workspace.forward(raw, PINHOLE, BLEND)
    raw.sh[seen, 1:] = np.inf  # after the image was drawn: its sums are finite
    before = raw.sh[seen].copy(), raw.position[seen].copy()
    found = workspace.step(raw, adam, by_image_of(), RATES)
    assert found.not_finite == seen
    assert adam.steps[seen] == 0
    np.testing.assert_array_equal(raw.position[seen], before[1])
