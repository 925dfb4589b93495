"""What every layer makes of the hard cases: prints the table, and writes docs/hard-cases.md. Run by `./dev hard`."""

import sys
import warnings

from bench import table
from hard_cases import softpipe
from hard_cases.case import GL_LAYERS
from hard_cases.cases import CASES
from hard_cases.layers import ALL_SETS, INSTRUCTION_SETS
from hard_cases.page import PAGE, number, page

from gsgi.runtime.gl.context import create_context


def main() -> None:
    """Run all cases; exit with 1 if one does not hold."""
    warnings.simplefilter("ignore")
    gl = create_context()
    errors, broken = {}, []
    for case in CASES:
        for layer, (value, _) in case.tolerances.items():
            if layer in ALL_SETS and layer not in INSTRUCTION_SETS:
                sys.exit(f"dev hard: this processor has no {layer}, which the page needs")
            try:
                error = (
                    softpipe.answers()[case.name]
                    if layer == softpipe.LAYER
                    else case.error(layer, gl if layer in GL_LAYERS else None)
                )
                assert error <= value, f"{error} is more than {value}"
                errors[case.name, layer] = error
            except AssertionError as failure:
                broken.append(f"{case.name}, {layer}: {failure}")
    rows = [
        {"case": case.name} | {layer: number(errors.get((case.name, layer), float("nan"))) for layer in case.tolerances}
        for case in CASES
    ]
    print(table(rows))
    print("\n".join(broken))
    if broken:
        sys.exit(1)
    PAGE.write_text(page(errors), encoding="utf-8")


if __name__ == "__main__":
    main()
