"""Several studies as one: a table that ranks the methods over all scenes."""

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from gsgi.runtime.atomic import write_together

from .plots import colour_of
from .ranking import COSTS

PAGE, DATA = "report.html", "summary.json"
SCHEMA = 1  # changes with every change of a key's meaning; new keys do not count
STYLE = """
  body { font: 15px/1.5 Inter, Helvetica, Arial, sans-serif; color: #222; margin: 24px auto; padding: 0 20px; }
  body { max-width: 1160px; } h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 17px; margin: 28px 0 6px; }
  p, footer { color: #555; margin: 4px 0; max-width: 900px; } div { overflow-x: auto; } a { color: #0072b2; }
  table { border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }
  th, td { text-align: left; padding: 3px 9px; border-bottom: 1px solid #e6e6e6; white-space: nowrap; }
  th { color: #555; border-bottom-color: #bbb; } td.number { text-align: right; } .missing { color: #999; }
  small { color: #555; display: block; }
  .swatch { display: inline-block; width: 10px; height: 10px; margin-right: 7px; }
  footer { font-size: 12.5px; margin: 48px 0 24px; border-top: 1px solid #ddd; padding-top: 10px; }
"""
EXPLAINED = """Of each method the smallest setting whose B (indirect light, albedo taken out) reaches an SSIM in views
that were not fitted. Methods that reach it in more scenes come first, then those with faster frames. Numbers of several
scenes are geometric means over the scenes in which the method reaches it. Light, ms: what a frame takes more than
without indirect light. Each scene has plots and pictures of its own:"""


def summarised(studies: Mapping[str, dict]) -> dict:
    """The rank table of studies (as `tables` makes them) by the names of their folders.

    For each goal of SSIM there is a row per method: the scenes in which it reaches it, with the entry that the scene's
    own ranking names, and geometric means of the costs over those scenes. Methods that reach it in more scenes come
    first, and of those the one with the faster frames.
    """
    titles = {method["name"]: method["title"] for study in studies.values() for method in study["methods"]}
    goals = next(iter(studies.values()))["ranking"]
    ranking = {}
    for goal in goals:
        rows = []
        for name, title in titles.items():
            found = {folder: _chosen(study, goal, name) for folder, study in studies.items()}
            there = [entry for entry in found.values() if entry]
            means = {cost: _mean([entry[cost] for entry in there]) for cost in (*COSTS, "more_ms")}
            rows.append({"method": name, "title": title, "reached": len(there), **means, "scenes": found})
        ranking[goal] = sorted(rows, key=lambda row: (-row["reached"], row["frame_ms"] or 0.0))
    scenes = {folder: study["scene"] | {"ceiling": study["ceiling"]} for folder, study in studies.items()}
    about = next(iter(studies.values()))["about"]
    return {"schema": SCHEMA, "scenes": scenes, "about": about, "ranking": ranking}


def write(studies: Mapping[str, dict], folder: Path) -> dict:
    """Write the page and its data to the folder above those of the studies, and return the data. Raises FileError."""
    data = summarised(studies)
    files = {PAGE: page(data).encode(), DATA: (json.dumps(data, indent=1) + "\n").encode()}
    write_together({folder / name: content for name, content in files.items()})
    return data


def page(data: dict) -> str:
    """The page, which needs nothing else but has links to the scenes' own."""
    links = ", ".join(f'<a href="{escape(name)}/report.html">{escape(name)}</a>' for name in data["scenes"])
    tables = "".join(_table(goal, rows, list(data["scenes"])) for goal, rows in data["ranking"].items())
    about = data["about"]
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>What accuracy costs</title>\n'
        f"<style>{STYLE}</style>\n<h1>What accuracy costs in {len(data['scenes'])} scenes</h1>\n"
        f"<p>{EXPLAINED} {links}.</p>\n{tables}"
        f"<footer>gsgi {escape(about['version'])}, commit {escape(about['commit'])} · {escape(about['processor'])}, "
        f"{about['cores']} cores · {escape(about['driver'])}</footer>\n</html>\n"
    )


def _chosen(study: dict, goal: str, method: str) -> dict | None:
    """What the study's ranking names for a method; None if it does not reach the goal."""
    keys = "label", "file_bytes", "gpu_bytes", "bake_seconds", "frame_ms", "more_ms"
    for place in study["ranking"][goal]:
        entry = study["entries"][place]
        if entry["method"] == method:
            return {key: entry[key] for key in keys} | {"ssim": entry["mean"]["ssim"]}
    return None


def _mean(values: Sequence[float]) -> float | None:
    """Geometric mean; 0 if a value is not above it, None of none."""
    if not values:
        return None
    return float(np.exp(np.log(values).mean())) if min(values) > 0 else 0.0


def _table(goal: str, rows: Sequence[dict], scenes: Sequence[str]) -> str:
    heads = ["method", "scenes", "bytes on disk", "bake, s", "light, ms", *scenes]
    body = "".join(_row(row, scenes) for row in rows)
    head = "".join(f"<th>{escape(head)}</th>" for head in heads)
    return f"<h2>SSIM of B of at least {goal}</h2>\n<div><table><tr>{head}</tr>{body}</table></div>\n"


def _row(row: dict, scenes: Sequence[str]) -> str:
    swatch = f'<span class="swatch" style="background:{colour_of(row["method"])}"></span>'
    numbers = [f"{row['reached']} of {len(scenes)}", _bytes(row["file_bytes"])]
    numbers += [_digits(row[cost]) for cost in ("bake_seconds", "more_ms")]
    cells = "".join(f'<td class="number">{number}</td>' for number in numbers)
    missing = "" if row["reached"] else ' class="missing"'
    there = "".join(_cell(row["scenes"][scene]) for scene in scenes)
    return f"<tr{missing}><td>{swatch}{escape(row['title'])}</td>{cells}{there}</tr>\n"


def _cell(entry: dict | None) -> str:
    if entry is None:
        return '<td class="missing">not reached</td>'
    costs = f"{_bytes(entry['file_bytes'])}, {_digits(entry['bake_seconds'])} s, {_digits(entry['more_ms'])} ms"
    return f"<td>{escape(entry['label']) or 'SSIM ' + format(entry['ssim'], '.4f')}<small>{costs}</small></td>"


def _bytes(count: float | None) -> str:
    if count is None:
        return ""
    for size, unit in ((1e6, "MB"), (1e3, "kB")):
        if count >= size:
            return f"{_digits(count / size)} {unit}"
    return f"{_digits(count)} B"


def _digits(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
