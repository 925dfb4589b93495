"""docs/hard-cases.md: the cases, and the worst error of each in each layer."""

import re
from collections.abc import Mapping
from itertools import groupby

from repository import ROOT

from .case import Case, Tolerance
from .cases import CASES

PAGE = ROOT / "docs" / "hard-cases.md"
HEAD = """# Hard cases

Scenes, Gaussians, cameras and files that are hard for the numerics, and the worst error of each layer. Written by
`./dev hard` from `tests/hard_cases/`, which the tests run too, but for slow ones; each error is below its tolerance,
which the tables after the errors name with its source. An error of Gaussians and cameras is in parts of the brightest
light, one of a `file` in parts of the worst that its format allows, and one of a room that must have another's light in
parts of the difference that another seed makes. "refused" stands where an error message is the right answer.
"""
# In the order of the columns.
LAYERS = {
    "oracle": "numpy in double, the definition; held to closed forms where there are any, here by float32 parameters",
    "torch": "its differentiable twin",
    "double": "the C++ kernels in double",
    "scalar": "the C++ kernels as they run in a bake and an evaluation",
    "avx2": "the same",
    "avx512": "the same",
    "llvmpipe": "the shaders, in a host's frame, on one rasteriser",
    "softpipe": "and on another",
    "sample": "`gsgi.sample`, in numpy",
    "look-up": "`gsgi_indirect()` in GLSL, on llvmpipe",
    "C": "the C library, at points, from a file",
    "gradient, double": "derivatives by the C++ kernels against those of the twin",
    "gradient, float": "the same in float32; with `surface` against double",
    "file": "encoded and decoded",
    "kernels": "C++ that has but one implementation",
    "search": "the search for a budget",
    "tracer": "the path tracer, on points",
    "bake": "a bake by `surface` with few samples, read at points by `gsgi.sample`",
    "frame": "its light in frames of the deferred renderer, on llvmpipe",
    "frame of over": "the same of a bake by `over`",
    "drop-in": "`gsgi.runtime.pyrender`, on llvmpipe",
    "reader": "`read_gltf`",
    "validator": "`gsgi validate`",
    "runtime": "numpy that has but one implementation",
}
WORST = "## Nearest to its tolerance, in each layer"

Errors = Mapping[tuple[str, str], float]  # by name of the case and layer


def page(errors: Errors) -> str:
    """The page; an error that is missing is 0."""
    groups = [(name, list(cases)) for name, cases in groupby(CASES, lambda case: case.group)]
    layers = "".join(f"| `{layer}` | {what} |\n" for layer, what in LAYERS.items())
    head = f"{HEAD}\n| layer | what |\n|---|---|\n{layers}"
    return head + f"\n{_worst(errors)}" + "".join(f"\n{_section(name, cases, errors)}" for name, cases in groups)


def without_numbers(text: str) -> str:
    """The page without what differs from run to run: its errors, and which of them are the worst."""
    text = re.sub(rf"{WORST}\n.*?(?=\n## )", "", text, flags=re.DOTALL)
    return re.sub(r"(?<=\| )[0-9.e+-]+(?= \|)", "0", text)


def _worst(errors: Errors) -> str:
    worst: dict[str, tuple[float, Case]] = {}
    for case in CASES:
        for layer, (tolerance, _) in case.tolerances.items():
            share = errors.get((case.name, layer), 0.0) / tolerance if tolerance else 0.0
            if share > worst.get(layer, (0.0, case))[0]:
                worst[layer] = share, case
    rows = "".join(
        f"| {layer} | {case.group}, {case.name} | {number(errors[case.name, layer])} "
        f"| {number(case.tolerances[layer].value)} |\n"
        for layer, (_, case) in sorted(worst.items(), key=lambda item: -item[1][0])
    )
    return f"{WORST}\n\n| layer | case | error | tolerance |\n|---|---|---|---|\n{rows}"


def _section(name: str, cases: list[Case], errors: Errors) -> str:
    used = {layer for case in cases for layer in case.tolerances}
    layers = [layer for layer in LAYERS if layer in used]
    assert used == set(layers), used - set(LAYERS)
    title = f"## {name}\n\n| case | what must hold | {' | '.join(layers)} |\n|---|---|{'---|' * len(layers)}\n"
    return title + "".join(_row(case, layers, errors) for case in cases) + "\n" + _tolerances(cases)


def _row(case: Case, layers: list[str], errors: Errors) -> str:
    cells = [_error(case, layer, errors) if layer in case.tolerances else "" for layer in layers]
    return f"| {case.name} | {case.holds} | {' | '.join(cells)} |\n"


def _error(case: Case, layer: str, errors: Errors) -> str:
    return "refused" if case.refused else number(errors.get((case.name, layer), 0.0))


def _tolerances(cases: list[Case]) -> str:
    """Each tolerance of a group once, with the layers that have it, and the cases if they are few."""
    users: dict[Tolerance, list[tuple[Case, str]]] = {}
    for case in cases:
        for layer, tolerance in case.tolerances.items():
            users.setdefault(tolerance, []).append((case, layer))
    rows = ""
    for tolerance, pairs in users.items():
        names = list(dict.fromkeys(case.name for case, _ in pairs))
        which = "" if len(names) > 3 else f" of {', '.join(names)}"
        layers = ", ".join(dict.fromkeys(layer for _, layer in pairs))
        rows += f"| `{number(tolerance.value)}` | {layers}{which} | {tolerance.source} |\n"
    return f"| tolerance | layers | where it comes from |\n|---|---|---|\n{rows}"


def number(value: float) -> str:
    """Two significant digits."""
    return f"{value:.2g}"
