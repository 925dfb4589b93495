"""The rules between the parts: who may import what, and where shared things stand."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from repository import ROOT

RUNTIME = sorted((ROOT / "runtime").rglob("*.py"))
BAKER = sorted((ROOT / "baker").rglob("*.py"))
ROOMS_THAT_DRAW = "gl", "panda3d", "pyrender", "testing", "viewer"  # folders of the runtime; all others hold data alone
DATA_MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in RUNTIME
    if path.relative_to(ROOT / "runtime").parts[0] not in ROOMS_THAT_DRAW and path.stem != "__init__"
)


def imports(path: Path, module_level: bool = False) -> set[str]:
    """Absolute names of the modules that a file imports, relative ones resolved within gsgi."""
    package = ["gsgi", *path.parent.relative_to(ROOT).parts]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = tree.body if module_level else ast.walk(tree)
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("path", RUNTIME, ids=lambda path: path.name)
def test_the_runtime_imports_no_baker_no_torch_nothing_compiled(path):
    for name in imports(path):
        assert not name.startswith("gsgi.baker"), name
        assert name.split(".")[0] not in {"torch", "mitsuba", "drjit", "open3d"}, name
        assert "_kernels" not in name


# Modules that draw as a whole have a folder of their own, which others import only inside functions.
DRAWING = ROOT / "baker" / "tradeoff" / "gl"


@pytest.mark.parametrize("path", [path for path in BAKER if path.parent != DRAWING], ids=lambda path: path.name)
def test_the_baker_imports_gl_modules_lazily_only(path):
    drawing = *(f"gsgi.runtime.{room}." for room in ROOMS_THAT_DRAW), "gsgi.baker.tradeoff.gl."
    keys = "gsgi.runtime.viewer.controls"  # text alone, which `gsgi view --help` prints
    loaded = (f"{name}." for name in imports(path, module_level=True) if not name.startswith(keys))
    assert not [name for name in loaded if name.startswith(drawing)]


# A room of the baker imports rooms before it, and what lies in no room: the records that all pass around.
ROOMS = (
    *("cache", "trace", "views", "fitting", "over", "surface", "evaluation", "update", "tasks", "cluster", "world"),
    "tradeoff",
)
RECORDS = {"interrupts", "native", "neighbours", "progress", "settings", "together"}
# What rooms that bake import besides: the study and worlds whole bakes, the tasks what a bake is made of.
WHOLE_BAKES = {
    "update": {"plan"},
    "tradeoff": {"plan", "bake"},
    "tasks": {"plan", "bake", "job", "estimate"},
    "world": {"plan", "plan_table", "job", "report", "effects", "estimate"},
}


def room_of(name: str) -> str | None:
    """The room of a module of the baker; None for one in no room."""
    parts = name.split(".")
    return parts[2] if len(parts) > 3 or parts[2] in (*ROOMS, "cli") else None


@pytest.mark.parametrize("path", [path for path in BAKER if path.parent.name in ROOMS], ids=lambda path: path.name)
def test_rooms_of_the_baker_import_only_rooms_before_them(path):
    mine = path.parent.name
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing = {id(node) for block in ast.walk(tree) if isinstance(block, ast.If) for node in ast.walk(block)}
    for node in ast.walk(tree):
        name = node.module or "" if isinstance(node, ast.ImportFrom) and not node.level else ""
        if name.startswith("gsgi.baker.") and id(node) not in typing:
            room = room_of(name)
            allowed = RECORDS | WHOLE_BAKES.get(mine, set())
            assert name.split(".")[2] in allowed if room is None else ROOMS.index(room) <= ROOMS.index(mine), name
            assert {mine, room} != {"over", "surface"}, "the two fits know nothing of each other"


@pytest.mark.parametrize("path", [*RUNTIME, *BAKER], ids=lambda path: path.name)
def test_only_bakes_on_a_cluster_import_ray(path):
    inside = path.parent.name == "cluster"
    assert "ray" not in {name.split(".")[0] for name in imports(path, module_level=inside)}


def loaded_by(code: str) -> set[str]:
    """Top-level packages outside the standard library that a fresh interpreter holds after `code`."""
    listing = "; import sys; print(*{name.split('.')[0] for name in sys.modules} - set(sys.stdlib_module_names))"
    run = subprocess.run([sys.executable, "-c", code + listing], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


@pytest.mark.parametrize("module", DATA_MODULES)
def test_a_data_module_loads_numpy_alone(module):
    started = loaded_by("pass")
    assert loaded_by(f"import gsgi.{module}") - started <= {"gsgi", "numpy"}


def test_help_loads_nothing_heavy():
    started = loaded_by("pass")
    assert loaded_by("from gsgi.baker.cli.main import parser; parser().format_help()") - started <= {"gsgi"}


def test_the_logic_of_the_viewer_needs_no_window():
    started = loaded_by("pass")
    assert loaded_by("import gsgi.runtime.viewer.controls") - started <= {"gsgi"}
    assert loaded_by("import gsgi.runtime.viewer.fly_camera") - started <= {"gsgi", "numpy"}


def test_the_pytest_plugin_loads_pytest_alone():
    """It is loaded in every run of every project that has gsgi installed."""
    assert loaded_by("import gsgi.runtime.testing.plugin") - loaded_by("import pytest") <= {"gsgi"}


def test_only_the_codec_knows_the_bytes_of_a_file():
    """`codec` is the way in; what it is made of is nobody else's to import."""
    parts = {
        f"gsgi.runtime.file.{part}"
        for part in ("header", "levels", "codes", "colours", "integers", "order", "rotations")
    }
    for path in [*RUNTIME, *BAKER]:
        if path.parent != ROOT / "runtime" / "file":
            assert 'b"GSGI"' not in path.read_text(encoding="utf-8"), path
            assert not imports(path) & parts, path


def test_shared_numbers_stand_once():
    text = (ROOT / "glsl" / "lib" / "constants.glsl").read_text(encoding="utf-8")
    literals = re.findall(r"^#define\s+\w+\s+(\d+\.\d{4,}|\d+\.\d+e-?\d+)", text, re.MULTILINE)
    assert len(literals) > 5
    sources = [*RUNTIME, *BAKER, *(ROOT / "baker" / "kernels").rglob("*"), *(ROOT / "glsl").rglob("*")]
    for path in sources:
        if path.name != "constants.glsl" and path.is_file():
            content = path.read_text(encoding="utf-8")
            for literal in literals:
                assert literal[:8] not in content, (path, literal)


def test_every_constant_is_a_literal_with_a_reason():
    for line in (ROOT / "glsl" / "lib" / "constants.glsl").read_text(encoding="utf-8").splitlines():
        assert not line.startswith("#") or re.match(r"#define \w+ +-?[\d.e-]+ +// \S", line) or "PI" in line, line
