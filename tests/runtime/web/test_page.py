"""The exported page in a browser, against our own renderer's frame of the same camera."""

import base64
import io
import json
import re
from dataclasses import replace
from urllib.parse import urlencode

import flip_evaluator
import numpy as np
import oracle
import pytest
import scenes
from browser import screenshot, visit
from bumpy import bumpy_room
from frames import full_scene
from javascript import JS
from PIL import Image
from repository import TESTS
from surface_cases import grouped, with_relief
from surface_frames import surface_gaussians

from gsgi.runtime.display import to_uint8, tone_map
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Effects, OverBlend, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.scene import Filter, Material, Scene, TextureSlot
from gsgi.runtime.web.page import MODULES, PAGE, write_page

WIDTH, HEIGHT = 320, 240
SAMPLES = 4  # per pixel and axis, of our own frame: the browser smooths edges too
EXPOSURE = 0.7
WEIGHTS = {"lamps": 0.1, "base": 0.6, "sky": 1.5}
LAYERS = {"on": "final", "off": "primary", "only": "indirect"}
PAGES = TESTS / "runtime" / "js" / "pages"


def open_page(folder, settings: list[dict], *flags: str, **more) -> dict:
    """What pages/page.js reads of the page in `folder`."""
    query = urlencode({"width": WIDTH, "height": HEIGHT, "settings": json.dumps(settings), **more})
    found = visit(f"pages/page.html?{query}", {"pages": PAGES, "site": folder}, *flags)
    restored = [found["restored"]["picture"]] if "restored" in found else []
    for picture in [*found.get("pictures", ()), *restored]:
        pixels = np.frombuffer(base64.b64decode(picture["rgb"]), np.uint8)
        picture["pixels"] = pixels.reshape(picture["height"], picture["width"], 3)
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A scene with everything, its bake in light groups, and the folder of its page."""
    scene = full_scene()
    scene = replace(scene, lights=(replace(scene.lights[0], name="lamp 1"), *scene.lights[1:]))
    fine = surface_gaussians(Scene(scene.meshes, scene.materials), 800)
    bake = with_relief(grouped(Bake(fine, SurfaceBlend(), coarse=oracle.random_gaussians(30, 2, seed=1))))
    data = codec.encode(bake)
    folder = tmp_path_factory.mktemp("site")
    write_page(folder, scene, codec.decode(data), data, {"inside": scenes.inside_camera()}, "room <1>")
    return scene, codec.decode(data), folder


@pytest.fixture(scope="module")
def found(made):
    """The page's pictures, one for each of LAYERS, and one with WEIGHTS."""
    settings = [{"gi": gi, "exposure": EXPOSURE} for gi in LAYERS]
    result = open_page(made[2], [*settings, settings[0] | {"weights": WEIGHTS}], moves=1)
    assert "error" not in result, result["error"]
    return result


@pytest.fixture(scope="module")
def drawn(gl, made):
    """Our own layers (H SAMPLES, W SAMPLES, 3), and whether a pixel's surface is even (H, W)."""
    scene, bake, _ = made
    renderer = DeferredRenderer(gl, scene, bake, WIDTH * SAMPLES, HEIGHT * SAMPLES)
    renderer.render(scenes.inside_camera())
    layers = {layer: renderer.read(layer) for layer in (*LAYERS.values(), "depth", "normal", "albedo")}
    renderer.weights = WEIGHTS
    renderer.render(scenes.inside_camera())
    layers["weighted"] = renderer.read("final")
    renderer.release()
    rims = [np.ptp(blocks(layers[name]), axis=2) for name in ("depth", "indirect")]
    even = (rims[0][..., 0] < 0.05) & (rims[1].max(axis=-1) < 0.02) & (blocks(layers["depth"]).min(axis=(2, 3)) > 0)
    return layers, even


def blocks(layer: np.ndarray) -> np.ndarray:
    """The samples of each pixel, (H, W, SAMPLES^2, C)."""
    split = layer.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES, -1).swapaxes(1, 2)
    return split.reshape(HEIGHT, WIDTH, SAMPLES * SAMPLES, -1)


@pytest.mark.parametrize(("number", "layer"), list(enumerate([*LAYERS.values(), "weighted"])))
def test_the_picture_is_that_of_our_own_renderer(found, drawn, number, layer):
    layers, _ = drawn
    expected = blocks(tone_map(layers[layer], EXPOSURE)).mean(axis=2).astype(np.float32)
    shown = found["pictures"][number]["pixels"].astype(np.float32) / 255
    flip = flip_evaluator.evaluate(expected, shown, "LDR")[1]
    print(f"FLIP {flip:.4f}")
    assert flip <= 0.02


def test_b_alone_is_within_one_step(found, drawn):
    layers, even = drawn
    expected = to_uint8(tone_map(blocks(layers["indirect"]).mean(axis=2), EXPOSURE)).astype(int)
    off = np.abs(found["pictures"][2]["pixels"] - expected)[even]
    assert even.mean() > 0.3
    assert off.max() <= 1


def test_b_follows_normal_maps(gl, tmp_path):
    """B is that of our own frame within a step, and far from that of light that does not follow them."""
    scene = bumpy_room()
    fine = surface_gaussians(scene, 800)
    bake = Bake(fine, SurfaceBlend(), coarse=oracle.random_gaussians(30, 2, seed=1))
    data = codec.encode(with_relief(bake))
    light, plain = codec.decode(data), codec.decode(codec.encode(bake))
    write_page(tmp_path, scene, light, data, scene.cameras, "bumpy room")
    found = open_page(tmp_path, [{"gi": "only", "exposure": EXPOSURE}])
    assert (found.get("error"), found["console"]) == (None, [])
    shown = found["pictures"][0]["pixels"].astype(int)
    of_maps, of_planes = (drawn_b(gl, scene, each) for each in (light, plain))
    even = np.ptp(of_maps, axis=2).max(axis=-1) < 0.02
    off, without = (np.abs(shown - to_uint8(tone_map(b.mean(axis=2), EXPOSURE)))[even] for b in (of_maps, of_planes))
    assert even.mean() > 0.3
    assert off.max() <= 1
    assert without.mean() > 5


def drawn_b(gl, scene: Scene, bake: Bake) -> np.ndarray:
    """Samples of B in our own frame of the page's size, (H, W, SAMPLES^2, 3)."""
    renderer = DeferredRenderer(gl, scene, bake, WIDTH * SAMPLES, HEIGHT * SAMPLES)
    renderer.render(scenes.inside_camera())
    read = blocks(renderer.read("indirect"))
    renderer.release()
    return read


def test_the_page_says_what_it_shows(found):
    assert found["console"] == []
    assert found["title"] == "room <1>"
    assert found["about"].startswith("830 Gaussians, ")
    assert found["groups"] == ["base", "lamps", "sky"]
    on, off, only, _ = found["milliseconds"]
    print(f"{on:.1f} ms a frame with light, {off:.1f} without, {only:.1f} for B alone; ready after {found['ready']} ms")
    assert 0 < found["ready"] <= found["loaded"]


def test_its_picture_can_be_taken(made):
    """As `./dev bench web` does for the README: a view of the whole window, in which the camera sees the scene."""
    address, ready = "site/index.html#camera=inside", "document.documentElement.dataset.loaded"
    shot = Image.open(io.BytesIO(screenshot(address, {"site": made[2]}, (WIDTH, HEIGHT), ready)))
    assert shot.size == (WIDTH, HEIGHT)
    assert len(np.unique(np.asarray(shot.convert("L")))) > 50


def test_one_flies_and_then_orbits_from_there(found):
    start, flown, turned, orbiting = ({key: np.array(value) for key, value in pose.items()} for pose in found["poses"])
    way = flown["position"] - start["position"]
    np.testing.assert_allclose(way / np.linalg.norm(way), start["ahead"], atol=1e-3)
    np.testing.assert_allclose(turned["position"], flown["position"])
    angle = np.arctan2(*turned["ahead"][[0, 2]]) - np.arctan2(*flown["ahead"][[0, 2]])
    assert np.sin(angle) == pytest.approx(np.sin(0.3), abs=1e-3)  # 100 px; what was under the finger stays there
    np.testing.assert_allclose(turned["ahead"][1], flown["ahead"][1], atol=1e-6)
    for key in ("position", "ahead"):
        np.testing.assert_allclose(orbiting[key], turned[key], atol=1e-3)


def test_a_lost_context_comes_back_with_its_shadows(made):
    lost = open_page(made[2], [{"gi": "off", "exposure": EXPOSURE}], loses=1)
    assert lost["restored"]["drawn"] > 0
    np.testing.assert_array_equal(lost["restored"]["picture"]["pixels"], lost["pictures"][0]["pixels"])


def test_an_exposure_that_cannot_be_is_left_out(made):
    given = [open_page(made[2], [], hash=f"exposure={exposure}")["exposure"] for exposure in ("0.25", "", -1, "x")]
    assert given[0] == 0.25
    assert given[1] > 0
    assert given[2:] == given[1:2] * 2


def test_a_browser_without_webgl_says_so(made):
    assert "needs WebGL 2" in open_page(made[2], [], "--disable-3d-apis")["error"]


def test_a_missing_file_is_named(made, tmp_path):
    for path in made[2].rglob("*"):
        if path.is_file() and path.name != "scene.bin":
            (tmp_path / path.relative_to(made[2])).parent.mkdir(exist_ok=True)
            (tmp_path / path.relative_to(made[2])).write_bytes(path.read_bytes())
    assert open_page(tmp_path, [])["error"].startswith("scene.bin: 404")


def test_the_page_holds_all_that_it_loads(made):
    files = {path.relative_to(made[2]).as_posix() for path in made[2].rglob("*") if path.is_file()}
    assert {*PAGE, *(f"gsgi/{name}" for name in MODULES)} <= files
    own = {path.name for path in (JS / "page").iterdir()} - {"vendor.js"}
    assert own == set(PAGE)
    text = "".join(
        (made[2] / name).read_text() for name in files if name.endswith((".html", ".js")) and name != "three.js"
    )
    assert "https://" not in text
    for name in MODULES:
        imported = re.findall(r"""(?:from |import\()"\./(.+?)\"""", (made[2] / "gsgi" / name).read_text())
        assert {f"gsgi/{other}" for other in imported} <= files
    description = json.loads((made[2] / "scene.json").read_text())
    loaded = [description["data"], description["light"], description["environment"]["file"]]
    loaded += [image["file"] for image in description["images"]]
    assert description["bytes"] == sum((made[2] / name).stat().st_size for name in loaded)


def test_light_of_the_over_operator_is_refused(tmp_path, made):
    bake = Bake(made[1].gaussians, OverBlend(near=0.01))
    with pytest.raises(UnsupportedError, match="over"):
        write_page(tmp_path, made[0], bake, b"", {}, "")


def test_stand_ins_are_there_for_their_shadows(tmp_path, made):
    scene, bake, _ = made
    first = len(scene.materials)
    film = Material("film", (1, 1, 1, 0.8), TextureSlot(0), filter=Filter(blends=True, clear=0.5), stand_in=True)
    pane = Material("pane", filter=Filter(transmission=0.9, clear=np.inf), stand_in=True)
    sheets = scenes.floor(0.5, 0.1, first), scenes.floor(0.5, 0.2, first + 1)
    scene = replace(scene, materials=(*scene.materials, film, pane), meshes=(*scene.meshes, *sheets))
    for effects, expected in ((Effects.CLEAR_PANE, [("film", 0.625)]), (Effects(0), [("film", None), ("pane", None)])):
        folder, plain = tmp_path / str(int(effects)), replace(bake, groups=(), effects=bake.effects | effects)
        folder.mkdir()
        write_page(folder, scene, plain, codec.encode(plain), {}, "")
        materials = json.loads((folder / "scene.json").read_text())["materials"]
        assert [(each["name"], each["alphaCutoff"]) for each in materials if each["standIn"]] == expected


def test_films_are_blended_back_to_front(gl, made, tmp_path):
    """Two of them, lit, the farther first in one file and last in the other."""
    scene, bake, _ = made
    colors = (0.9, 0.2, 0.1), (0.1, 0.3, 0.9)
    materials = [Material("film", (*color, 0.4), double_sided=True) for color in colors]
    films = [
        scenes.quad([(-0.5, -0.9, z), (0.6, -0.9, z), (0.6, 0.6, z), (-0.5, 0.6, z)], len(scene.materials) + k)
        for k, z in enumerate((0.2, -0.2))
    ]
    pictures = []
    for number, order in enumerate((films, films[::-1])):
        blended = replace(scene, materials=(*scene.materials, *materials), blended=tuple(order))
        folder = tmp_path / str(number)
        folder.mkdir()
        plain = replace(bake, groups=())
        write_page(folder, blended, plain, codec.encode(plain), {"inside": scenes.inside_camera()}, "films")
        found = open_page(folder, [{"gi": "on", "exposure": EXPOSURE}])
        assert (found["console"], found["groups"]) == ([], [])
        pictures.append(found["pictures"][0]["pixels"].astype(np.float32) / 255)
    np.testing.assert_array_equal(*pictures)
    renderer = DeferredRenderer(gl, blended, bake, WIDTH * SAMPLES, HEIGHT * SAMPLES)
    renderer.render(scenes.inside_camera())
    expected = blocks(tone_map(renderer.read("final"), EXPOSURE)).mean(axis=2).astype(np.float32)
    renderer.release()
    flip = flip_evaluator.evaluate(expected, pictures[0], "LDR")[1]
    print(f"FLIP {flip:.4f}")
    assert flip <= 0.02
