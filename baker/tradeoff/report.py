"""The files of a study: a page that opens without a network, its data, and its plots."""

import json
from pathlib import Path

from gsgi.runtime.atomic import write_together
from gsgi.runtime.errors import FileError, FormatError

from .pictures import pictures
from .plots import colour_of, png, shapes, svg
from .ranking import COSTS
from .study import Study
from .tables import SCHEMA, as_dict, rows

PAGE, DATA = "report.html", "study.json"
TEMPLATE = Path(__file__).with_name("report.html")


def write(study: Study, folder: Path, scene: str, command: str) -> dict:
    """Write all files of a study to a folder that exists, and return its data. Raises FileError."""
    data = as_dict(study, scene, command)
    plots = {cost: shapes(data, cost) for cost in COSTS}
    drawn = {cost: svg(parts) for cost, parts in plots.items()}
    files = {PAGE: page(data, pictures(study), drawn).encode(), DATA: (json.dumps(data, indent=1) + "\n").encode()}
    files["study.csv"] = rows(data).encode()
    for cost, parts in plots.items():
        name = f"error-{cost.replace('_', '-')}"
        files |= {f"{name}.svg": drawn[cost].encode(), f"{name}.png": png(parts)}
    write_together({folder / name: content for name, content in files.items()})
    return data


def page(data: dict, images: dict, plots: dict[str, str]) -> str:
    """The page, with everything that it shows inside."""
    colours = {method["name"]: colour_of(method["name"]) for method in data["methods"]}
    embedded = {"study": data, "pictures": images, "colours": colours}
    text = TEMPLATE.read_text(encoding="utf-8")
    for cost, drawn in plots.items():
        text = text.replace(f"<!-- plot {cost} -->", drawn)
    # "</script>" in a name must not end the script that holds it.
    return text.replace('"the data"', json.dumps(embedded).replace("</", "<\\/"))


def read(folder: Path) -> dict:
    """The data of a study in a folder. Raises FileError, and FormatError for what is no study of this version."""
    path = folder / DATA
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
