"""What a frame runs: only the passes and the code that scene and file call for, and what they cost."""

from dataclasses import replace

import pytest
import scenes
from frames import bake, full_scene, surface_bake
from gl_objects import alive

from gsgi.baker.cli.commands.render import print_costs
from gsgi.runtime.gl import shader
from gsgi.runtime.gl.profile import Profile
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Scene

SIZE = 96, 64
SURFACE = ["surface/points", "surface/read", "frame/composite"]


def measured(gl, scene: Scene, baked) -> dict:
    renderer = DeferredRenderer(gl, scene, baked, *SIZE)
    renderer.render(scenes.inside_camera(), profile := Profile(gl))
    renderer.release()
    return {cost.name: cost for cost in profile.passes}


def lit(**missing) -> Scene:
    return replace(full_scene(), **missing)


@pytest.mark.parametrize(
    ("scene", "baked", "passes"),
    [
        (scenes.furnace(), None, ["frame/gbuffer"]),
        (lit(lights=()), None, ["frame/gbuffer", "frame/background"]),
        (lit(environment=None), None, ["frame/gbuffer", "frame/shadow", "frame/primary"]),
        (
            lit(),
            bake(),
            ["frame/gbuffer", "frame/background", "frame/shadow", "frame/primary", "over/splat", "frame/composite"],
        ),
        (scenes.furnace(), surface_bake(), ["frame/gbuffer", *SURFACE]),
    ],
)
def test_only_the_passes_that_are_called_for(gl, scene, baked, passes):
    assert list(measured(gl, scene, baked)) == passes


def test_costs_count_what_was_drawn(gl):
    everything = measured(gl, lit(), surface_bake())
    pixels = SIZE[0] * SIZE[1]
    assert everything["frame/composite"].fragments == pixels
    assert everything["frame/gbuffer"].fragments >= pixels - everything["frame/background"].fragments > 0
    assert 0 < everything["frame/primary"].fragments <= 3 * pixels  # one for each light, where it shines
    assert everything["surface/read"].fragments == pixels
    assert not any(cost.quads for cost in everything.values())
    splats = measured(gl, lit(), bake())["over/splat"]
    assert splats.quads > 0
    assert splats.fragments > 0
    assert all(cost.cpu_ms > 0 for cost in everything.values())
    assert sum(cost.gpu_ms for cost in everything.values()) > 0


def test_profiles_share_their_queries(gl):
    """moderngl cannot delete a query, and a host may make a profile for each frame."""

    def measure_two_passes():
        profile = Profile(gl)
        for name in ("a", "b"):
            with profile.measure(name):
                pass

    measure_two_passes()
    before = alive(gl)["Query"]
    for _ in range(10):
        measure_two_passes()
    assert alive(gl)["Query"] == before


@pytest.fixture
def compiled(monkeypatch) -> list[tuple[str, dict]]:
    """(file, defines) of all that is compiled."""
    found, source = [], shader.source
    monkeypatch.setattr(
        shader, "source", lambda name, defines, *rest: (found.append((name, defines)), source(name, defines, *rest))[1]
    )
    return found


def on(compiled, prefix: str) -> set[str]:
    """Defines that are not 0 in any program whose name begins so."""
    return {key for name, defines in compiled if name.startswith(prefix) for key, value in defines.items() if value}


def test_a_plain_scene_compiles_no_code_for_any_effect(gl, compiled):
    measured(gl, scenes.furnace(), surface_bake())
    files = {name.partition(".")[0] for name, _ in compiled} - {"lib/fullscreen"}
    assert files == {
        "frame/gbuffer",
        "surface/points",
        "surface/read",
        "surface/add_light",
        "frame/composite",
        "frame/display",
    }
    assert on(compiled, "frame/gbuffer") == set()
    assert on(compiled, "surface/points") == {"SPLAT_SCALE", "NORMAL_OCTAHEDRAL"}
    assert on(compiled, "surface/read") == {"SPLAT_SCALE", "FINE_SH_COUNT", "COARSE_SH_COUNT"}


@pytest.mark.parametrize(
    ("field", "value", "define"),
    [
        ("base_color_texture", None, "BASE_TEXTURE"),
        ("metallic_texture", None, "METALLIC_TEXTURE"),
        ("normal_texture", None, "NORMAL_TEXTURE"),
        ("emission_texture", None, "EMISSION_TEXTURE"),
        ("alpha_cutoff", None, "ALPHA_MASK"),
        ("unlit", False, "UNLIT"),
    ],
)
def test_without_an_effect_there_is_no_code_for_it(gl, compiled, field, value, define):
    metals = "black"  # rough ones have one albedo, whatever their metallic texture says
    measured(gl, lit(metals=metals), None)
    assert define in on(compiled, "frame/gbuffer")
    compiled.clear()
    materials = tuple(replace(material, **{field: value}) for material in full_scene().materials)
    measured(gl, lit(materials=materials, metals=metals), None)
    assert define not in on(compiled, "frame/gbuffer") | on(compiled, "frame/shadow")
    if define == "NORMAL_TEXTURE":
        assert "INTERPOLATED" not in on(compiled, "frame/gbuffer")


@pytest.mark.parametrize(("kind", "defines"), [("point", {"FACES"}), ("spot", {"SPOT", "FACES"}),
                                               ("directional", {"DIRECTIONAL", "FACES"})])  # fmt: skip
def test_each_kind_of_light_compiles_its_own_code_alone(gl, compiled, kind, defines):
    lights = tuple(light for light in full_scene().lights if light.kind == kind)
    measured(gl, lit(lights=lights), None)
    assert on(compiled, "frame/primary") == defines
    faces = {values["FACES"] for name, values in compiled if name.startswith("frame/primary")}
    assert faces == {6 if kind == "point" else 1}


def test_the_table_ends_with_the_sum(capsys):
    row = {"name": "frame/gbuffer", "gpu_ms": 1.25, "cpu_ms": 0.5, "quads": 0, "fragments": 7}
    print_costs("llvmpipe, 4.5", [row, row | {"name": "over/splat", "quads": 3}])
    driver, *lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert driver == ["llvmpipe,", "4.5"]
    assert lines[1:] == [
        ["frame/gbuffer", "1.25", "0.50", "7"],
        ["over/splat", "1.25", "0.50", "3", "7"],
        ["all", "2.50", "1.00"],
    ]
