"""The choice of the device that traces. Where there is a GPU, it traces what the CPU traces."""

import os
import subprocess
import sys

import numpy as np
import pytest
import scenes
from repository import ROOT

from gsgi.baker.cache.store import MemoryCache
from gsgi.baker.settings import Settings
from gsgi.baker.tasks.request import Request
from gsgi.baker.trace import device
from gsgi.baker.trace.cached_tracer import CachedTracer
from gsgi.baker.trace.planes import planes, traced_planes
from gsgi.runtime.errors import UnsupportedError, UsageError

NO_GPU = device.unavailable()
needs_gpu = pytest.mark.skipif(NO_GPU is not None, reason=str(NO_GPU))


@pytest.fixture(autouse=True)
def chosen_again(monkeypatch):
    monkeypatch.setattr(device, "_chosen", None)


def test_the_cpu_traces_unless_something_else_is_chosen():
    assert device.device() == "cpu"
    assert device.choose("cpu") == "cpu"
    assert "CPU" in device.title()


def test_auto_is_the_cpu_where_no_gpu_can_trace(monkeypatch):
    monkeypatch.setattr(device, "unavailable", lambda: "there is none")
    assert device.choose("auto") == "cpu"
    with pytest.raises(UnsupportedError, match="there is none"):
        device.choose("cuda")
    assert device.device() == "cpu"


def test_a_gpu_that_can_trace_is_chosen_and_named(monkeypatch):
    monkeypatch.setattr(device, "unavailable", lambda: None)
    monkeypatch.setattr(device, "gpu_name", lambda: "Some GPU")
    monkeypatch.delitem(sys.modules, "mitsuba", raising=False)
    assert device.choose("auto") == device.device() == "cuda"
    assert device.title() == "Some GPU (CUDA)"


def test_another_name_is_refused():
    with pytest.raises(UsageError, match="expected one of auto, cpu, cuda, got 'gpu'"):
        device.choose("gpu")


def test_one_process_traces_on_one_device(monkeypatch):
    class Mitsuba:
        variant = staticmethod(lambda: "llvm_ad_rgb")

    monkeypatch.setitem(sys.modules, "mitsuba", Mitsuba)
    monkeypatch.setattr(device, "unavailable", lambda: None)
    with pytest.raises(UsageError, match="llvm_ad_rgb"):
        device.choose("cuda")
    assert device.choose("cpu") == "cpu"


def test_what_one_device_has_finished_is_not_what_is_asked_of_another(monkeypatch):
    digests = []
    for name in ("cpu", "cuda", "cpu"):
        monkeypatch.setattr(device, "_chosen", name)
        digests.append(Request(scenes.furnace(0.5), Settings()).digest)
    assert digests[0] == digests[2] != digests[1]


@pytest.mark.parametrize(
    ("probe", "reason"),
    [
        ("print(True)", None),
        ("raise RuntimeError('no OptiX')", "no OptiX"),
        ("import os; os.abort()", "ended with code -6"),
        ("import time; time.sleep(60)", "did not end"),
    ],
)
def test_the_reason_says_what_a_probe_found(monkeypatch, probe, reason):
    monkeypatch.setattr(device, "gpu_name", lambda: "Some GPU")
    monkeypatch.setattr(device, "_PROBE", probe)
    monkeypatch.setattr(device, "TIMEOUT", 1.0 if "sleep" in probe else 60.0)
    found = device.unavailable()
    assert found is None if reason is None else reason in found


def test_tasks_of_a_gpu_have_keys_of_their_own(monkeypatch):
    tracer = CachedTracer(scenes.furnace(), MemoryCache())
    keys = []
    for name in ("cpu", "cuda"):
        monkeypatch.setattr(device, "_chosen", name)
        keys.append(tracer.key("points", "gsgi.baker.trace.cached_tracer", seed=1))
    assert keys[0] != keys[1]


def test_rays_start_further_off_where_a_gpu_meets_triangles(monkeypatch):
    """A floor along two axes, for which a CPU's intersections are exact."""
    corners = np.float32([[0, 0, 0], [9, 0, 0], [0, 0, 9]]), np.array([[0, 1, 2]], np.uint32)
    monkeypatch.setattr(device, "_chosen", "cuda")
    assert traced_planes(*corners)[0, 1] == np.float32(9 * 2.0**-22)
    assert planes(*corners)[0, 1] == 0  # for rays of Embree
    monkeypatch.setattr(device, "_chosen", "cpu")
    assert traced_planes(*corners)[0, 1] == 0


_TRACED = """
import sys
import numpy as np
import scenes
from gsgi.baker.trace import device
from gsgi.baker.trace.tracer import Sampling, Tracer
device.choose(sys.argv[1])
scene = scenes.spot_room()
corners = np.concatenate([mesh.position[mesh.triangle] for mesh in scene.meshes])
normal = np.concatenate([mesh.normal[mesh.triangle] for mesh in scene.meshes]).mean(axis=1)
weights = np.random.default_rng(3).dirichlet([1, 1, 1], 64)
position = np.einsum("wc,fcx->fwx", weights, corners).reshape(-1, 3).astype(np.float32)
normal = np.repeat(normal / np.linalg.norm(normal, axis=1, keepdims=True), 64, axis=0).astype(np.float32)
np.save(sys.argv[2], Tracer(scene).indirect(position, normal, normal, Sampling(64, 8), 5).mean)
"""


@needs_gpu
def test_a_gpu_traces_the_light_that_the_cpu_traces(tmp_path):
    """The same paths: they part only where rounding decides what a ray meets."""
    environment = os.environ | {"PYTHONPATH": str(ROOT / "tests")}
    light = []
    for name in ("cpu", "cuda"):
        file = tmp_path / f"{name}.npy"
        subprocess.run([sys.executable, "-c", _TRACED, name, file], check=True, env=environment)
        light.append(np.load(file))
    assert (np.abs(light[1] - light[0]) <= 1e-3 * light[0].mean()).mean() > 0.95
    np.testing.assert_allclose(light[1].mean(axis=0), light[0].mean(axis=0), rtol=1e-2)
