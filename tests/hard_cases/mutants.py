"""Break central formulas on purpose, one at a time, and see which hard case or test notices.

`cd tests; ../.venv/bin/python -m hard_cases.mutants` prints a line for each; a mutant that survives needs a case. With
words, only mutants whose names have one of them are tried. It changes the working tree and puts it back, and builds the
kernels anew for those in C++: minutes.
"""

import os
import re
import subprocess
import sys
from typing import NamedTuple

from repository import ROOT, TESTS

CASES, FIT, BLENDED = "hard_cases/test_cases.py", "baker/surface/test_fit.py", "runtime/gl/test_blended.py"


class Mutant(NamedTuple):
    """`old` becomes `new` in the file at `path`, where it stands once; one of `tests` must notice."""

    name: str
    path: str
    old: str
    new: str
    tests: str = CASES


MUTANTS = [
    Mutant("a sign in the projection's Jacobian", "glsl/lib/projection.glsl", "-1.0, -slope.y", "-1.0, slope.y"),
    Mutant("no frustum clamp", "glsl/lib/projection.glsl", "clamp(t.xy / depth, -limit, limit)", "t.xy / depth"),
    Mutant("a factor in the Gaussian", "glsl/surface/weight.glsl", "exp(-0.5 * dot(e, e))", "exp(-0.6 * dot(e, e))"),
    Mutant("no cut-off", "glsl/surface/weight.glsl", "exp(-0.5 * dot(e, e)) - cutoff", "exp(-0.5 * dot(e, e))"),
    Mutant("normals that face away", "glsl/surface/weight.glsl", "float c = max(0.0, cosine)", "float c = abs(cosine)"),
    Mutant("a sign in the SH basis", "glsl/lib/sh.glsl", "basis[3] = -SH_C1 * d.x", "basis[3] = SH_C1 * d.x"),
    Mutant("no cap on alpha", "glsl/over/splat.frag", "min(alpha_max, v_color.a * exp(-dot(e, e)))",
           "v_color.a * exp(-dot(e, e))"),
    Mutant("no gap below the floor", "runtime/sampling.py", "sums[thin, :3] += gap[thin, None] * _mean(rest)",
           "sums[thin, :3] += 0 * _mean(rest)"),
    Mutant("the order of the file", "runtime/gl/sort.py", "keys.sort()", "keys = keys[::-1]"),
    Mutant("slopes of axes that changed places", "runtime/file/codes.py", "slope[swapped, ::-1] * [1, -1]",
           "slope[swapped, ::-1]"),
    Mutant("rays that start on the surface", "baker/trace/rays.py", "p + ng * dr.maximum(height, LEAST)", "p + ng * 0"),
    Mutant("a sign in the gradient by depth", "baker/kernels/over/projection.h", "y * at.y + jacobian) / at.depth",
           "y * at.y - jacobian) / at.depth"),
    Mutant("a factor in the gradient by opacity", "baker/kernels/surface/field_read.h",
           "p * w * L(1 - gaussian.opacity)",
           "p * w"),
    Mutant("cells that end too early", "runtime/cell_lists.py", "SLACK = 1e-5", "SLACK = -0.2"),
    Mutant("the other half of a cell", "glsl/surface/lookup.glsl", "vec3(4.0, 2.0, 1.0)", "vec3(1.0, 2.0, 4.0)"),
    Mutant("cuts that cost more than they gain", "baker/surface/fit.py", "> -CUT_COST", "> -np.inf", FIT),
    Mutant("holes where there is none", "baker/surface/fit.py", "weight < optimiser.blend.floor",
           "weight >= optimiser.blend.floor", FIT),
    Mutant("faces that stay on each other", "baker/trace/overlaps.py", "APART = 4.0", "APART = 0.0"),
    Mutant("lamps that count twice", "baker/trace/duplicates.py", "keep[some] = False", "keep[some] = True"),
    Mutant("lamps in one plane that count twice", "baker/trace/overlaps.py", "before[pairs[:, 1]] + 1",
           "before[pairs[:, 1]]"),
    Mutant("films seen through walls", "glsl/frame/gbuffer.frag", "v_depth > solid * (1.0 + SAME_DEPTH)",
           "v_depth > solid * 9.0", BLENDED),
    Mutant("films without B", "glsl/frame/blend.frag", "radiance += reflectance.rgb * gsgi_indirect",
           "radiance += 0.0 * gsgi_indirect", BLENDED),
    Mutant("points that stay on edges", "baker/trace/planes.py", "EDGE = 2.0**-22", "EDGE = 0.0"),
]  # fmt: skip


def main() -> None:
    """Exit with 1 if a mutant survives."""
    survivors = 0
    for mutant in MUTANTS:
        if sys.argv[1:] and not any(word in mutant.name for word in sys.argv[1:]):
            continue
        path = ROOT / mutant.path
        text = path.read_text(encoding="utf-8")
        assert text.count(mutant.old) == 1, mutant
        try:
            path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
            rebuild(path)
            caught = first_failure(mutant.tests)
        finally:
            path.write_text(text, encoding="utf-8")
            rebuild(path)
        survivors += caught is None
        print(f"{mutant.name} ({mutant.path}): {caught or 'SURVIVES'}", flush=True)
    sys.exit(bool(survivors))


def rebuild(path) -> None:
    """Build the kernels anew if `path` is one of their sources."""
    if "kernels" in path.parts:
        uv = next((at for at in (ROOT / "build/uv/bin/uv",) if at.exists()), "uv")
        extras = [f"--extra={name}" for name in ("bake", "decoders", "pyrender", "test", "view")]
        command = [uv, "sync", "--locked", "--inexact", "--quiet", *extras, "--reinstall-package", "gsgi"]
        subprocess.run(command, cwd=ROOT, env=os.environ | {"GSGI_REQUIRE_KERNELS": "1"}, check=True)


def first_failure(tests: str) -> str | None:
    """The test that fails first, without softpipe, which is slow; None if all hold."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-k",
        "not softpipe and not page",
        tests,
    ]
    run = subprocess.run(command, cwd=TESTS, capture_output=True, text=True)
    found = re.search(r"^(?:FAILED|ERROR) \S*?\.py::(.*?)(?: - .*)?$", run.stdout, re.MULTILINE)
    assert run.returncode in (0, 1), run.stdout
    return found[1] if found else None if run.returncode == 0 else run.stdout[-300:]


if __name__ == "__main__":
    main()
