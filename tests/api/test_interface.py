"""`import gsgi`: each name of the stub is there, and nothing is loaded before it is used."""

import ast
import subprocess
import sys

import pytest
from repository import ROOT, SCENES

import gsgi

STUB = ROOT / "api" / "gsgi" / "__init__.pyi"
NAMES = [alias.name for node in ast.parse(STUB.read_text(encoding="utf-8")).body for alias in node.names]


@pytest.mark.parametrize("name", NAMES)
def test_every_name_of_the_stub_is_there(name):
    assert getattr(gsgi, name).__name__ == name
    assert name in dir(gsgi)


@pytest.mark.parametrize("name", NAMES)
def test_the_documentation_names_it(name):
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    assert name in page


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'gsgi' has no attribute 'bakery'"):
        gsgi.bakery  # noqa: B018


def test_the_import_loads_nothing():
    code = "import sys; before = set(sys.modules); import gsgi; print(*(set(sys.modules) - before))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert [name for name in run.stdout.split() if name.split(".")[0] not in sys.stdlib_module_names] == ["gsgi"]


def test_without_the_kernels_baking_says_what_to_install():
    code = (
        "import sys; sys.modules['gsgi.baker._kernels'] = None; import gsgi\n"
        "try: gsgi.bake\nexcept gsgi.UnsupportedError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "without its compiled kernels" in run.stdout


def test_without_the_extra_baking_says_what_to_install():
    code = (
        "import sys; sys.modules['open3d'] = None; import gsgi\n"
        f"try: gsgi.bake({str(SCENES / 'cornell.glb')!r}, cache=False)\n"
        "except gsgi.UnsupportedError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "baking needs open3d: install gsgi with its extra 'bake'\n"
