"""Light groups: which lights are in which, what is refused, and how weights add up."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
from surface_cases import gaussians, grouped, points

import gsgi
from gsgi.runtime.errors import SceneError
from gsgi.runtime.gaussians import Bake, LightGroup, OverBlend, SurfaceBlend
from gsgi.runtime.light_groups import (
    BASE,
    check_groups,
    dimmed,
    factors_of,
    group_of,
    lit_by,
    lit_groups,
    names_of,
    sources,
    weighted,
    with_each,
)
from gsgi.runtime.lighting import Lighting, light
from gsgi.runtime.scene import Environment, Light, Material, Scene


def lamp(name: str, entry: str = "") -> Light:
    return Light("point", np.array([4.0, 2.0, 1.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]), name=name, entry=entry)


def scene(**groups: tuple[str, ...]) -> Scene:
    """Two lamps, a sun, a glowing sign, a wall that does not emit, and a sky."""
    materials = scenes.WHITE, Material("sign", emission=(2.0, 1.0, 0.0)), Material("unused", emission=(1.0, 1.0, 1.0))
    sky = Environment(np.array([[[1, 2, 3]], [[4, 5, 6]]], np.float32))
    lights = lamp("lamp.001", "Desk"), lamp("lamp.002", "Desk")
    made = Scene((scenes.floor(), scenes.floor(material=1)), materials, lights=lights, environment=sky, groups=groups)
    return light(made, Lighting(sun=(90, 30), groups=groups))


def members(lit: Scene) -> dict[str, str]:
    return {names_of(source)[0]: group_of(names_of(source), lit.groups) for source in sources(lit)}


@pytest.mark.parametrize(
    ("patterns", "inside"),
    [
        (("lamp.001",), {"lamp.001"}),
        (("lamp*",), {"lamp.001", "lamp.002"}),
        (("Desk",), {"lamp.001", "lamp.002"}),
        (("lamp.00[2-9]", "sun"), {"lamp.002", "sun"}),
        (("s*",), {"sign", "sun"}),
        (("environment",), {"environment"}),
        (("*",), {"lamp.001", "lamp.002", "sun", "sign", "environment"}),
    ],
)
def test_patterns_match_names_of_lights_nodes_and_materials(patterns, inside):
    lit = scene(some=patterns)
    check_groups(lit)
    found = members(lit)
    assert {name for name, group in found.items() if group == "some"} == inside
    assert set(found.values()) <= {"some", BASE}
    assert lit_groups(lit) == [BASE, "some"] if len(inside) < 5 else ["some"]


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        (
            {"a": ("lamp",)},
            r"^group 'a': expected a pattern that matches a light \('lamp.001', .*'sign', 'environment'\)",
        ),
        ({"a": ("white",)}, "^group 'a': expected a pattern that matches a light .* got 'white'$"),
        ({"a": ("unused",)}, "^group 'a': expected a pattern that matches a light .* got 'unused'$"),
        ({"a": ()}, "^group 'a': expected 1 to 255 patterns, got 0$"),
        ({"a": ("lamp*",) * 256}, "^group 'a': expected 1 to 255 patterns, got 256$"),
        ({"a": ("*" * 65536,)}, r"^group 'a': expected a pattern of at most 65535 bytes .* got '\*+'$"),
        ({"a": ("*\udc80",)}, "^group 'a': expected a pattern .* that can be printed"),
        ({"a": ("lamp*",), "b": ("*.002",)}, "^point light 'lamp.002': expected one group, got 'a', 'b'$"),
        ({"base": ("lamp*",)}, "^group 'base': expected another name"),
        ({"\udc80": ("lamp*",)}, "^group .*: expected a name of 1 to 255 bytes that can be printed"),
        ({"": ("lamp*",)}, "^group '': expected a name of 1 to 255 bytes"),
        ({"a\nb": ("lamp*",)}, r"^group 'a\\nb': expected a name"),
    ],
)
def test_groups_that_cannot_be_are_named(groups, message):
    with pytest.raises(SceneError, match=message):
        check_groups(scene(**groups))


def test_each_light_can_be_a_group():
    lit = scene()
    each = with_each(lit, {"lamps": ("lamp*",)})
    assert list(each) == ["lamps", "sun", "sign", "environment"]
    check_groups(replace(lit, groups=each))
    assert members(replace(lit, groups=with_each(lit, {})))["lamp.002"] == "lamp.002"
    odd = replace(lit, lights=(lamp("lamp [1]"), lamp("lamp 1")), groups={})
    assert members(replace(odd, groups=with_each(odd, {})))["lamp 1"] == "lamp 1"  # brackets are no pattern
    with pytest.raises(SceneError, match=r"^point light: expected a name"):
        with_each(replace(lit, lights=(lamp(""),)), {})
    with pytest.raises(SceneError, match=r"^group 'sun': expected one, but"):
        with_each(lit, {"sun": ("lamp*",)})


def test_the_scenes_of_groups_add_up():
    lit = scene(lamps=("lamp*",), warm=("sign", "environment"))
    parts = [lit_by(lit, name) for name in lit_groups(lit)]
    assert [len(part.lights) for part in parts] == [1, 2, 0]
    assert [part.environment is not None for part in parts] == [False, False, True]
    emission = np.sum([[m.emission for m in part.materials] for part in parts], axis=0)
    np.testing.assert_array_equal(emission[:2], [m.emission for m in lit.materials][:2])


def test_light_is_dimmed_by_the_factor_of_its_group():
    lit = scene(lamps=("lamp*",), warm=("sign", "environment"))
    half = dimmed(lit, lit.groups, {BASE: (0.0,) * 3, "lamps": (0.5, 0.0, 2.0), "warm": (1.0, 1.0, 0.25)})
    assert [one.name for one in half.lights] == ["lamp.001", "lamp.002"]
    np.testing.assert_array_equal(half.lights[0].color, [2, 0, 2])
    assert half.materials[1].emission == (2.0, 1.0, 0.0)
    np.testing.assert_array_equal(half.environment.radiance[0, 0], [1, 2, 0.75])


def bake(sloped: bool = True) -> Bake:
    fine, coarse = gaussians(60, sloped=sloped), gaussians(20, 9, seed=7)
    return grouped(Bake(fine, SurfaceBlend(cutoff=0.1, sharpness=3, floor=0.2), coarse=coarse))


def test_weights_of_one_are_the_bake_itself():
    made = bake()
    assert weighted(made, {}) is weighted(made, {"lamps": 1, BASE: (1, 1, 1)}) is made
    position, normal = points(500)
    np.testing.assert_array_equal(gsgi.sample(made, position, normal, {}), gsgi.sample(made, position, normal))


def test_light_does_not_jump_when_a_weight_leaves_one():
    """The groups of this bake add up to far more than its own light."""
    made, (position, normal) = bake(), points(500)
    whole = gsgi.sample(made, position, normal)
    assert whole.any(axis=1).mean() > 0.5
    for weights in ({"lamps": 0.99999}, {"sky": 1.00001, BASE: (1, 1, 0.99999)}):
        np.testing.assert_allclose(gsgi.sample(made, position, normal, weights), whole, rtol=1e-3, atol=1e-4)
    half = dict.fromkeys((BASE, "lamps", "sky"), 0.5)
    np.testing.assert_allclose(gsgi.sample(made, position, normal, half), 0.5 * whole, rtol=1e-5, atol=1e-6)


def test_light_is_linear_in_the_weights():
    """Without slopes, where the groups add up to the bake, it is the sum of what each group gives alone."""
    bright, (position, normal) = bake(sloped=False), points(500)
    for group in bright.groups:
        group.coarse_sh[:, 1:] *= 0.1 * group.coarse_sh[:, :1]  # so small that no light is below 0
    bright.gaussians.sh[:] = sum(group.sh for group in bright.groups)
    bright.coarse.sh[:] = sum(group.coarse_sh for group in bright.groups)
    alone = {
        name: gsgi.sample(bright, position, normal, {other: float(other == name) for other in (BASE, "lamps", "sky")})
        for name in (BASE, "lamps", "sky")
    }
    weights = {"lamps": 0.2, "sky": (1, 0.5, 3)}
    expected = alone[BASE] + 0.2 * alone["lamps"] + np.array([1, 0.5, 3]) * alone["sky"]
    assert expected.any(axis=1).mean() > 0.5
    np.testing.assert_allclose(gsgi.sample(bright, position, normal, weights), expected, rtol=1e-4, atol=1e-5)


def test_slopes_of_one_group_stay_and_those_of_equal_light_are_averaged():
    made = bake()
    lamps = made.groups[1]
    off = {BASE: 0, "sky": 0}
    np.testing.assert_allclose(weighted(made, off | {"lamps": 2}).gaussians.slope, lamps.slope, rtol=1e-4, atol=1e-6)
    same = LightGroup("sky", (), lamps.sh, -lamps.slope, lamps.coarse_sh)
    whole = replace(made.gaussians, sh=2 * lamps.sh, slope=np.zeros_like(lamps.slope))
    equal = replace(made, gaussians=whole, groups=(lamps, same))
    np.testing.assert_allclose(weighted(equal, {"sky": 3}).gaussians.slope, -lamps.slope / 2, rtol=1e-4, atol=1e-6)
    assert not weighted(made, {"lamps": 0} | off).gaussians.slope.any()


def test_all_groups_off_is_dark():
    made, (position, normal) = bake(), points(200)
    assert not gsgi.sample(made, position, normal, {BASE: 0, "lamps": 0, "sky": 0}).any()


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"lamp": 1}, "^weights: the bake has no light group 'lamp': it has 'base', 'lamps', 'sky'$"),
        ({"lamps": "2"}, "^weights: 'lamps': expected one or three numbers from 0 to 1e.*, got '2'$"),
        ({"lamps": ("1", "2", "3")}, "^weights: 'lamps': expected one or three numbers from 0 to 1e"),
        ({"lamps": (1, (2, 3), 4)}, "^weights: 'lamps': expected one or three numbers from 0 to 1e"),
        ({"lamps": -1}, "^weights: 'lamps': expected one or three numbers from 0 to 1e"),
        ({"lamps": np.nan}, "^weights: 'lamps': expected one or three numbers"),
        ({"lamps": (1, 2)}, r"^weights: 'lamps': .* got \(1, 2\)$"),
        ({"lamps": "bright"}, "^weights: 'lamps': .* got 'bright'$"),
        ([1, 2], "^weights: expected weights by the names of light groups, got list$"),
    ],
)
def test_weights_that_cannot_be_are_named(weights, message):
    with pytest.raises(ValueError, match=message):
        factors_of(bake(), weights)


def test_a_bake_without_groups_has_no_weights():
    plain = replace(bake(), groups=())
    assert factors_of(plain, {}) == {}
    assert weighted(plain, {}) is plain
    for one in (plain, Bake(gaussians(3), OverBlend(0.1))):
        with pytest.raises(
            ValueError, match=r"^weights: the bake has no light group 'base': it was baked without groups$"
        ):
            factors_of(one, {"base": 1})
