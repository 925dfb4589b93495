"""samples/08_c_host: a renderer in C, in OpenGL and in OpenGL ES, against our own frame of the same scene."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_library import build
from repository import ROOT, SAMPLES

from gsgi.baker.over.initialise import from_surface
from gsgi.baker.views.surface_points import Triangles
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, OverBlend, SurfaceBlend
from gsgi.runtime.gl.renderer import DeferredRenderer
from gsgi.runtime.gltf.reader import read_gltf

SAMPLE = SAMPLES / "08_c_host"
SIZE = 320, 320
SCENE = read_gltf(SAMPLES / "scenes" / "cornell.glb")


# Arguments of the program, and what makes Mesa say that it has no more than the oldest version.
_LATER = "viewport_array clip_control draw_buffers_blend stencil_texturing"
OLD = {
    "MESA_GL_VERSION_OVERRIDE": "3.3",
    "MESA_EXTENSION_OVERRIDE": " ".join(f"-GL_ARB_{name}" for name in _LATER.split()),
}
VERSIONS = ((), {}), ((), OLD), (("es",), {}), (("es",), {"MESA_GLES_VERSION_OVERRIDE": "3.0"})


def bake(operator: str) -> Bake:
    points = Triangles(SCENE).sample(1500, 0)
    light = (0.5 + 0.4 * np.sin(9 * points.position)).astype(np.float32)
    fine = from_surface(points.position, points.normal, light, 0)
    if operator == "over":
        return Bake(fine, OverBlend(near=0.01))
    return Bake(fine, SurfaceBlend(), coarse=from_surface(points.position[:9], points.normal[:9], light[:9], 0))


@pytest.fixture(scope="module")
def host(tmp_path_factory) -> Path:
    """The program, which stops where AddressSanitizer or UndefinedBehaviorSanitizer finds something."""
    for header in ("EGL/egl.h", "GL/glcorearb.h"):
        command = ["cc", "-E", "-include", header, "-x", "c", "/dev/null"]
        if subprocess.run(command, capture_output=True).returncode:
            pytest.skip(f"the sample needs {header} (Debian: libegl-dev, libgl-dev)")
    folder = tmp_path_factory.mktemp("c_host")
    return build(folder, source=SAMPLE, flags="-fsanitize=address,undefined -fno-sanitize-recover=all") / "host"


def read_ppm(path: Path) -> np.ndarray:
    """(H, W, 3) uint8."""
    magic, size, top, data = path.read_bytes().split(b"\n", 3)
    assert (magic, size, top) == (b"P6", b"%d %d" % SIZE, b"255")
    return np.frombuffer(data, np.uint8).reshape(SIZE[1], SIZE[0], 3)


@pytest.mark.parametrize("operator", ["surface", "over"])
def test_the_host_in_c_draws_what_our_own_renderer_draws(gl, host, tmp_path, operator):
    (tmp_path / "cornell.gsgi").write_bytes(codec.encode(bake(operator)))
    renderer = DeferredRenderer(gl, SCENE, codec.decode((tmp_path / "cornell.gsgi").read_bytes()), *SIZE, splat_scale=2)
    renderer.render(SCENE.cameras["front"])
    light = renderer.read("indirect") * renderer.read("albedo")
    renderer.release()
    expected = 255 * np.clip(light, 0, 1) ** (1 / 2.2)
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}  # the drivers' memory is theirs to free
    for flavour, version in VERSIONS:
        command = [host, tmp_path / "cornell.gsgi", tmp_path / "frame.ppm", *flavour]
        run = subprocess.run(command, env=environment | version, capture_output=True, text=True)
        assert (run.returncode, run.stderr) == (0, "")
        error = np.abs(read_ppm(tmp_path / "frame.ppm") - expected).max(axis=-1)
        assert expected.mean() > 60
        assert error.mean() < 1  # bytes of albedo
        assert (error > 4).mean() < 2e-3  # outlines


def test_what_the_driver_lacks_is_named(host, tmp_path):
    (tmp_path / "cornell.gsgi").write_bytes(codec.encode(bake("over")))
    without = {"MESA_EXTENSION_OVERRIDE": "-GL_EXT_float_blend", "ASAN_OPTIONS": "detect_leaks=0"}
    command = [host, tmp_path / "cornell.gsgi", tmp_path / "frame.ppm", "es"]
    run = subprocess.run(command, env=os.environ | without, capture_output=True, text=True)
    assert run.stderr == "gsgi: context: GL_EXT_float_blend is needed by the operator over\n"


def test_a_file_that_is_none_is_one_line(host, tmp_path):
    run = subprocess.run([host, SAMPLE / "host.c", tmp_path / "frame.ppm"], capture_output=True, text=True)
    assert run.returncode == 1
    assert run.stderr == "gsgi: byte 0 (magic): expected b'GSGI', got another: is it a .gsgi file?\n"


def test_a_host_needs_few_lines_of_gsgi():
    lines = (SAMPLE / "host.c").read_text().splitlines()
    ours = [line for line in lines if "gsgi" in line or "GSGI" in line]
    assert 10 < len(ours) <= 40


def test_the_code_of_the_page_is_that_of_the_sample():
    page = (ROOT / "docs" / "integrate.md").read_text()
    shown = [block.split("```")[0] for block in page.split("```c\n")[1:]]
    sample = (SAMPLE / "host.c").read_text()
    lines = {line.strip() for line in sample.splitlines()}
    assert len(shown) == 1
    code = [line.strip() for line in shown[0].splitlines() if line.strip() and "/*" not in line]
    assert len(code) > 10
    assert set(code) <= lines
