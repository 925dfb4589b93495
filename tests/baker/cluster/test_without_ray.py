"""`gsgi bake --ray` where it cannot work."""

import sys

from repository import SCENES
from small_tasks import run

FURNACE = str(SCENES / "furnace.glb")


def refused(capsys, code: int, *arguments: str) -> str:
    """The one line on stderr of a bake that ends with this exit code."""
    run("bake", FURNACE, *arguments, "--ray", "auto", code=code)
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    return said


def test_a_bake_on_a_cluster_needs_the_extra(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    line = refused(capsys, 5, "-o", str(tmp_path / "x.gsgi"))
    assert line == "gsgi: --ray needs ray: install gsgi with its extra 'cluster'\n"


def test_there_is_no_preview_of_what_happens_elsewhere(tmp_path, capsys):
    line = refused(capsys, 1, "-o", str(tmp_path / "x.gsgi"), "--preview", str(tmp_path))
    assert line.startswith("gsgi: --preview: shows the fit while it runs")
