"""Fuzz all targets for MINUTES in all: `./dev fuzz MINUTES`."""

import argparse
import sys

from repository import ROOT

from .corpus import fuzz, unpacked
from .targets import TARGETS


def main() -> None:
    """Exit with 1 if a target broke a promise; build/fuzz/ then has the file that it broke it with."""
    parser = argparse.ArgumentParser(prog="./dev fuzz", description=__doc__)
    parser.add_argument("minutes", type=float, help="wall-clock time, shared by the targets")
    seconds = 60 * parser.parse_args().minutes / len(TARGETS)
    folder = ROOT / "build" / "fuzz"
    broken = False
    for target in TARGETS:
        corpus = unpacked(target, folder / target)
        run = fuzz(target, corpus, folder, f"-max_total_time={seconds:.0f}")
        print(run.stdout)
        broken |= run.returncode != 0
    sys.exit(f"dev fuzz: see crash-* in {folder}" if broken else None)


if __name__ == "__main__":
    main()
