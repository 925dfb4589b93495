"""Open3D is loaded without the packages that it draws by, and draws by them all the same."""

import subprocess
import sys

import pytest

CODE = """
import sys
{first}
from gsgi.baker.views.open3d_module import load_open3d
o3d = load_open3d()
assert {{"plotly", "dash"}} & set(sys.modules) == {loaded}, "loaded"
points = o3d.utility.Vector3dVector([[0, 0, 0], [1, 2, 3]])
figure = o3d.visualization.get_plotly_fig([o3d.geometry.PointCloud(points)])
import plotly.graph_objects
assert type(figure) is plotly.graph_objects.Figure, type(figure)
assert len(figure.data) == 1, figure
"""


@pytest.mark.parametrize(("first", "loaded"), [("", "set()"), ("import plotly, dash", "{'plotly', 'dash'}")])
def test_it_draws_whether_or_not_its_packages_were_there_before(first, loaded):
    code = CODE.format(first=first, loaded=loaded)
    run = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
