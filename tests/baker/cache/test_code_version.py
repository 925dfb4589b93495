"""The name of the code behind a result: it covers what the code imports, and changes with it."""

import subprocess
import sys

import numpy as np

from gsgi.baker.cache import code_version as module
from gsgi.baker.cache.code_version import closure, code_version


def test_the_closure_holds_what_a_stage_computes_with_and_no_more():
    traced = set(closure("gsgi.baker.trace.tracer"))
    assert {
        "gsgi.baker.trace.tracer",
        "gsgi.baker.trace.paths",
        "gsgi.baker.trace.punctual_lights",
        "gsgi.runtime.scene",
    } <= traced
    assert (
        not {"gsgi.baker.cli.main", "gsgi.baker.over.fit", "gsgi.baker.cache.store", "gsgi.runtime.gltf.reader"}
        & traced
    )
    fitted = closure("gsgi.baker.over.fit")
    assert {"gsgi.baker.over.workspace", "gsgi.baker.fitting.loss", "gsgi.runtime.camera"} <= set(fitted)
    assert fitted["gsgi.baker._kernels"].suffix == ".so"
    assert all(name.split(".")[0] == "gsgi" for name in fitted)


def test_it_imports_none_of_them():
    code = (
        "import sys; from gsgi.baker.cache.code_version import closure; closure('gsgi.baker.over.fit');"
        "closure('gsgi.baker.trace.tracer'); print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"torch", "mitsuba", "gsgi.baker.over.fit", "gsgi.baker.trace.tracer"} & set(run.stdout.split())


def test_any_change_of_a_file_or_package_changes_the_version(tmp_path, monkeypatch):
    file = tmp_path / "a.py"
    monkeypatch.setattr(module, "closure", lambda name: {name: file})
    version = code_version.__wrapped__
    file.write_text("x = 1")
    first = version("gsgi.a", ("numpy",))
    assert version("gsgi.a", ("numpy",)) == first
    assert version("gsgi.a", ()) != first
    monkeypatch.setattr(module, "version", lambda package: np.__version__ + ".1")
    assert version("gsgi.a", ("numpy",)) != first
    monkeypatch.undo()
    monkeypatch.setattr(module, "closure", lambda name: {name: file})
    file.write_text("x = 2")
    assert version("gsgi.a", ("numpy",)) != first


def test_a_package_that_is_not_installed_has_no_version():
    assert module._version("no-such-package") is None
