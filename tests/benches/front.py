"""The picture of the front page: Sponza without baked light, with it, and path-traced."""

import numpy as np
from PIL import Image
from repository import ROOT, SHARED

import gsgi
from gsgi.baker.evaluation.comparison import compare_frame
from gsgi.baker.evaluation.pictures import panels
from gsgi.baker.trace import reference
from gsgi.baker.trace.tracer import Tracer
from gsgi.runtime.display import auto_exposure, tone_map
from gsgi.runtime.file import codec
from gsgi.runtime.gl.headless import draw

SCENE, CAMERA = SHARED / "sponza_crytek" / "sponza_sun.gltf", "atrium"
SIZE, SAMPLES = (600, 450), 512
PICTURE = ROOT / "build" / "bench" / "front.jpg"


def front() -> list[dict]:
    """Sponza with primary light, with a default bake, and path-traced; draws build/bench/front.jpg."""
    if not SCENE.exists():
        return []
    scene = gsgi.read_scene(SCENE, gsgi.Lighting(env=(1.0, 1.0, 1.0)))
    report = gsgi.bake(scene, evaluate=False, cache=ROOT / "build" / "bench" / "cache")
    layers = draw(scene, codec.decode(report.data), scene.cameras[CAMERA], *SIZE, "auto")
    truth = reference.trace(Tracer(scene), scene.cameras[CAMERA], *SIZE, SAMPLES, seed=7)
    traced = truth.lit(truth.clean)
    exposure = auto_exposure(traced)
    size = f"{len(report.data) / 1000:.0f} kB"
    pictures = {
        "primary light": layers["primary"],
        f"with gsgi: {report.gaussians:,} Gaussians, {size}": layers["final"],
        f"path-traced, {SAMPLES} samples per pixel": traced,
    }
    image = panels({name: tone_map(light.astype(np.float32), exposure) for name, light in pictures.items()})
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(PICTURE, quality=88)
    found = compare_frame(layers["final"], truth)
    row = {"gaussians": report.gaussians, "bytes": len(report.data), "ssim": round(found.ssim, 4)}
    return [{"scene": SCENE.stem, "camera": CAMERA} | row | {"file": PICTURE.name}]
