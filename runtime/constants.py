"""The constants of glsl/lib/constants.glsl as Python values."""

import re
from pathlib import Path

GLSL_FOLDER = Path(__file__).resolve().parents[1] / "glsl"

_DEFINE = re.compile(r"^#define\s+(\w+)\s+(\S+)", re.MULTILINE)

globals().update(
    {
        name: float(literal) if set(literal) & set(".eE") else int(literal)
        for name, literal in _DEFINE.findall((GLSL_FOLDER / "lib" / "constants.glsl").read_text(encoding="utf-8"))
    }
)
