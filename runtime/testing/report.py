"""Report of a run: a table of all comparisons, and text and pictures of the failures, in a single HTML file."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from .record import FIGURES, Record

_TEMPLATE = Path(__file__).with_name("report.html")
# Pictures from left to right, with their captions.
_SHOWN = {"expected": "expected", "actual": "actual", "difference": "difference (FLIP)"}

# FLIP is 0 for pixels that look the same and 1 for the greatest error; report.html has its colours.
_TICKS = "".join(f'<span style="--quarters: {i}">{i / 4:g}</span>' for i in range(5))
_LEGEND = f'<div class="legend"><i></i><b>{_TICKS}</b></div>'


def html(records: Sequence[Record], root: Path) -> str:
    """HTML page for the records of a run. Pictures are read below `root` and embedded in the page."""
    failed = [record for record in records if record.outcome == "failed"]
    passed = [record for record in records if record.outcome != "failed"]
    title = f"{len(failed)} of {len(records)} {'screenshot' if len(records) == 1 else 'screenshots'} failed"
    tables = _table(failed, linked=True)
    if passed:
        tables += f"\n<details><summary>{len(passed)} passed</summary>\n{_table(passed)}\n</details>"
    sections = "\n".join(_section(i, record, root) for i, record in enumerate(failed))
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(title=title, tables=tables, sections=sections)


def _table(records: Sequence[Record], linked: bool = False) -> str:
    names = "".join(f'<th class="figure">{name}<th class="figure">allowed' for name in FIGURES)
    rows = "\n".join(_row(record, f"#failure-{i}" if linked else "") for i, record in enumerate(records))
    return f"<table>\n<tr><th>Test<th>Screenshot<th>Verdict{names}<th>Golden image\n{rows}\n</table>"


def _row(record: Record, link: str) -> str:
    test, name, used = (escape(text) for text in (record.test, record.name, record.used))
    test = f'<a href="{link}">{test}</a>' if link else test
    figures = "".join(_figure_cells(name, record.figures.get(name)) for name in FIGURES)
    outcome = "failed" if record.outcome == "failed" else "passed"
    return f'<tr><td>{test}<td>{name}<td class="{outcome}">{_verdict(record)}{figures}<td>{used}'


def _figure_cells(name: str, figure: Sequence[float] | None) -> str:
    if figure is None:
        return "<td><td>"
    value, limit = figure
    above = "" if value <= limit else " above"
    spelled = FIGURES[name]
    return f'<td class="figure{above}">{spelled(value)}<td class="figure limit">{spelled(limit)}'


def _verdict(record: Record) -> str:
    if record.outcome != "failed":
        return record.outcome
    if not record.used:
        return "no golden image"
    return "differs" if record.figures else "other size"


def _section(index: int, record: Record, root: Path) -> str:
    figures = "\n".join(_figure(what, root / record.pictures[what]) for what in _SHOWN if what in record.pictures)
    return f"""<section id="failure-{index}">
<h2>{escape(record.test)}: {escape(record.name)}</h2>
<div class="row">
{figures}
</div>
<pre>{escape(record.message)}</pre>
</section>"""


def _figure(what: str, path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    picture = f'<img alt="{what}" src="data:image/png;base64,{data}">'
    return f"""<figure class="{what}"><div class="frame"><div class="stack">{picture}</div></div>
<figcaption>{_SHOWN[what]}</figcaption>{_LEGEND * (what == "difference")}</figure>"""
