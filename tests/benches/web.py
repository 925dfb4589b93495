"""The exported page: how large it is, how soon it is there, and what a frame costs in a software rasteriser."""

import io
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import urlencode

from browser import screenshot, visit
from PIL import Image
from repository import ROOT, SHARED, TESTS

import gsgi
from gsgi.runtime.file import codec
from gsgi.runtime.web.page import write_page

SCENE, CAMERA = SHARED / "sponza_crytek" / "sponza_sun.gltf", "atrium"
SIZE = 320, 180  # px, of the frames that are measured
WINDOW, EXPOSURE = (960, 540), 3  # of the picture
PICTURE = ROOT / "build" / "bench" / "web.jpg"
PAGES = TESTS / "runtime" / "js" / "pages"


def web() -> list[dict]:
    """Sponza with a draft bake as a page: bytes, ms until it can be used, ms per frame; draws build/bench/web.jpg."""
    if not SCENE.exists():
        return []
    scene = gsgi.read_scene(SCENE, gsgi.Lighting(env=(1.0, 1.0, 1.0)))
    data = gsgi.bake(scene, quality="draft", evaluate=False, cache=ROOT / "build" / "bench" / "cache").data
    with TemporaryDirectory() as folder:
        size = write_page(Path(folder), scene, codec.decode(data), data, scene.cameras, SCENE.stem)
        return [{"scene": SCENE.stem, "page_mb": round(size / 1e6, 1)} | measured(Path(folder))]


def measured(folder: Path) -> dict:
    """What a browser says of the page in `folder`; draws the picture."""
    settings = json.dumps([{"gi": gi, "camera": CAMERA} for gi in ("on", "off")])
    query = urlencode({"width": SIZE[0], "height": SIZE[1], "settings": settings})
    found = visit(f"pages/page.html?{query}", {"pages": PAGES, "site": folder})
    address, ready = f"site/index.html#camera={CAMERA}&exposure={EXPOSURE}", "document.documentElement.dataset.loaded"
    picture = Image.open(io.BytesIO(screenshot(address, {"site": folder}, WINDOW, ready)))
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    picture.convert("RGB").save(PICTURE, quality=85)
    on, off = (round(value, 1) for value in found["milliseconds"])
    return {"ready_ms": found["ready"], "loaded_ms": found["loaded"], "frame_ms": on, "without_ms": off}
