"""The files of a study: a page that opens without a network, its data, and its plots."""

import json
import re
from pathlib import Path

from gsgi.runtime.atomic import write_together
from gsgi.runtime.errors import FileError, FormatError

from . import plots as plotted
from . import time_plot
from .drawing import png, svg
from .pictures import pictures
from .ranking import COSTS
from .study import Study
from .tables import SCHEMA, as_dict, rows

PAGE, DATA = "report.html", "study.json"
TEMPLATE = Path(__file__).with_name("report.html")


def write(study: Study, folder: Path, scene: str, command: str, bake: str) -> dict:
    """Write all files of a study to a folder that exists, and return its data. Raises FileError.

    `command` made the study of `scene`, and `bake` is the command of a bake without its settings.
    """
    data = as_dict(study, scene, command, bake)
    plots = {f"error-{cost.replace('_', '-')}": (plotted.shapes(data, cost), plotted.HEIGHT) for cost in COSTS}
    if parts := time_plot.shapes(data):
        plots["time"] = parts, time_plot.height(data)
    drawn = {name: svg(*plot) for name, plot in plots.items()}
    files = {PAGE: page(data, pictures(study), drawn).encode(), DATA: (json.dumps(data, indent=1) + "\n").encode()}
    files["study.csv"] = rows(data).encode()
    for name, plot in plots.items():
        files |= {f"{name}.svg": drawn[name].encode(), f"{name}.png": png(*plot)}
    write_together({folder / name: content for name, content in files.items()})
    return data


def page(data: dict, images: dict, plots: dict[str, str]) -> str:
    """The page, with everything that it shows inside. `plots` are those as SVG, by the names of their files."""
    colours = {method["name"]: plotted.colour_of(method["name"]) for method in data["methods"]}
    embedded = {"study": data, "pictures": images, "colours": colours}
    text = TEMPLATE.read_text(encoding="utf-8")
    text = re.sub("<!-- plot (.*) -->", lambda found: plots.get(found[1], ""), text)
    # "</script>" in a name must not end the script that holds it.
    return text.replace('"the data"', json.dumps(embedded).replace("</", "<\\/"))


def read(folder: Path) -> dict:
    """The data of a study in a folder. Raises FileError, and FormatError for what is no study of this version."""
    path = folder / DATA
    if folder.is_file():
        raise FileError(f"{folder}: expected the folder of a study; `gsgi tradeoff {folder} -o DIR` makes one")
    if several := sorted(str(each.parent) for each in folder.glob(f"*/{DATA}") if not path.exists()):
        raise FileError(f"{folder}: a study of several scenes; expected one of {', '.join(several)}")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise FormatError(f"{path}: expected JSON: {error}") from None
    found = data.get("schema") if isinstance(data, dict) else None
    if found != SCHEMA:
        raise FormatError(f"{path}: schema: expected {SCHEMA}, got {found!r}")
    return data
