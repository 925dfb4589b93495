"""The error of each light group alone: what it is of known light, and that noise does not count."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from gsgi_files import constant

from gsgi.baker.cache.store import Cache
from gsgi.baker.evaluation import group_error
from gsgi.baker.evaluation.group_error import GroupError, measure
from gsgi.baker.evaluation.held_out import Evaluation
from gsgi.baker.evaluation.summary import summary
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.gaussians import LightGroup
from gsgi.runtime.light_groups import lit_by
from gsgi.runtime.scene import Light, Scene

VIEWS, PIXELS = 3, 4000
WARM, COLD = np.float32([1, 0.5, 0.25]), np.float32([0.25, 0.5, 2])


def halves(light: np.ndarray, noise: float, seed: int = 0):
    """Independent ones of a `light` (V, P, 3), with relative noise."""
    rng = np.random.default_rng(seed)
    return (light * (1 + noise * rng.normal(size=light.shape)) for _ in range(2))


@pytest.mark.parametrize("off", [0.0, 0.03, 0.2])
def test_noise_of_the_paths_does_not_count(off):
    truth = np.random.default_rng(1).uniform(0.5, 2, (VIEWS, PIXELS, 3))
    signs = np.random.default_rng(2).choice([-1, 1], truth.shape)
    errors = [group_error._error(truth * (1 + off * signs), *halves(truth, 0.3, s), np.ones(VIEWS)) for s in range(8)]
    assert np.mean([error for error, _ in errors]) == pytest.approx(off, abs=0.02)
    assert sum(off <= bound for _, bound in errors) >= 7
    assert all(bound < off + 0.06 for _, bound in errors)


def test_views_count_alike_however_bright():
    truth = np.ones((2, PIXELS, 3)) * [[[1.0]], [[100.0]]]
    error, bound = group_error._error(truth * [[[1.2]], [[1.0]]], truth, truth, np.array([1.0, 100]))
    assert error == pytest.approx(np.sqrt(0.2**2 / 2))
    assert bound == pytest.approx(error)


def test_only_views_that_the_group_lights_tell_of_it():
    truth = np.ones((2, PIXELS, 3)) * [[[1.0]], [[1e-4]]]
    light = truth * [[[1.1]], [[9.0]]]
    assert group_error._error(light, truth, truth, np.ones(2))[0] == pytest.approx(0.1)
    assert group_error._error(light, 0 * truth, 0 * truth, np.ones(2)) == (None, None)


def test_each_group_is_compared_with_its_own_lights():
    """Of two lights, one is 5 % too bright in the file."""
    at, down = np.zeros(3), np.array([0.0, -1, 0])
    lights = [Light("point", np.float64(color), at, down, name=name) for name, color in (("lamp", WARM), ("x", COLD))]
    scene = Scene((), (), lights=tuple(lights), groups={"lamps": ("lamp",)})

    def tracer(group: str):
        color = sum((light.color for light in lit_by(scene, group).lights), np.zeros(3))
        traced = lambda position, *_, **__: SimpleNamespace(mean=np.float32(color + 0 * position))  # noqa: E731
        return SimpleNamespace(at_points=traced)

    nowhere = np.zeros((16, 16, 3), np.float32)
    normals = np.broadcast_to(np.float32([0, 0, 1]), nowhere.shape)
    surface = SimpleNamespace(position=nowhere, normal=normals, shading_normal=normals, geometric_normal=normals)
    both = np.broadcast_to(WARM + COLD, nowhere.shape)
    reference = Reference(surface, None, both, both, np.ones((16, 16), bool))
    parts = {"base": ((), COLD), "lamps": (("lamp",), 1.05 * WARM)}
    groups = []
    for name, (patterns, light) in parts.items():
        part = constant(light)
        groups.append(LightGroup(name, patterns, part.gaussians.sh, part.gaussians.slope, part.coarse.sh))
    baked = replace(constant(WARM + COLD), groups=tuple(groups))
    plan = SimpleNamespace(settings=SimpleNamespace(seed=1), scene=scene, tracer=SimpleNamespace(lit_by=tracer))
    base, lamps = measure(plan, {"view": reference}, baked)
    assert (base.name, lamps.name) == ("base", "lamps")
    assert base.error < 1e-3
    assert lamps.error == pytest.approx(0.05, rel=1e-2)
    assert measure(plan, {"view": reference}, replace(baked, groups=())) == []
    assert measure(plan, {}, baked) == []


def test_the_walls_of_a_furnace_are_a_group():
    """A closed box that emits 1 at albedo 1/2: B is 2."""
    box = scenes.furnace(0.5)
    named = replace(box.materials[0], name="walls")
    scene = replace(box, materials=(named, *box.materials[1:]), groups={"walls": ("walls",)})
    tracer, bright = CachedTracer(scene, Cache()), constant([2, 2, 2])
    truth = tracer.reference(scenes.inside_camera(), 16, 64, 1, lambda *_: None)
    group = LightGroup("walls", ("walls",), bright.gaussians.sh, bright.gaussians.slope, bright.coarse.sh)
    plan = SimpleNamespace(settings=SimpleNamespace(seed=1), scene=scene, tracer=tracer)
    (found,) = measure(plan, {"view": truth}, replace(bright, groups=(group,)))
    assert found.name == "walls"
    assert found.error < found.bound < 0.02


def test_the_log_has_a_line_for_each():
    found = [GroupError("lamps", 0.031, 0.042), GroupError("day", None, None)]
    assert summary(Evaluation([], None, [], None, groups=found)) == [
        "light group lamps alone: B is off by 3.1% RMS, at most by 4.2%",
        "light group day: it lights none of these views",
    ]
