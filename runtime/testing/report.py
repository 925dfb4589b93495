"""Report of all failures: text and pictures in a single HTML file."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from .record import Record

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2em; color: #222; background: #f6f6f4 }}
section {{ background: #fff; padding: 1em 1.5em; margin: 1.5em 0; border: 1px solid #ddd }}
h2 {{ font-size: 1.1em; margin: 0 }}
pre {{ white-space: pre-wrap }}
figure {{ display: inline-block; margin: 0 1em 1em 0 }}
img {{ display: block; width: 420px; max-width: 90vw; image-rendering: pixelated; border: 1px solid #ddd }}
</style>
<h1>{title}</h1>
{sections}
</html>
"""
_SECTION = """<section>
<h2>{test}</h2>
<pre>{message}</pre>
{figures}
</section>"""
_FIGURE = """<figure><img alt="{what}" src="data:image/png;base64,{data}"><figcaption>{what}</figcaption></figure>"""


def html(failed: Sequence[Record], root: Path) -> str:
    """HTML page for records of failures. Their pictures are read below `root` and embedded in the page."""
    title = f"{len(failed)} {'screenshot' if len(failed) == 1 else 'screenshots'} failed"
    return _PAGE.format(title=title, sections="\n".join(_section(record, root) for record in failed))


def _section(record: Record, root: Path) -> str:
    visible = {what: root / path for what, path in record.pictures.items() if path.endswith(".png")}
    figures = "\n".join(_figure(what, path) for what, path in visible.items())
    return _SECTION.format(test=escape(record.test), message=escape(record.message), figures=figures)


def _figure(what: str, path: Path) -> str:
    return _FIGURE.format(what=escape(what), data=base64.b64encode(path.read_bytes()).decode())
