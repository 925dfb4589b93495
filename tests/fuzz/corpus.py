"""The corpus of a target, tests/data/fuzz/TARGET.zip, and runs that start with it."""

import subprocess
import sys
import zipfile
from pathlib import Path

from repository import DATA, TESTS

# Files of the targets take kilobytes and milliseconds; what takes more is broken.
LIMITS = "-timeout=20", "-max_len=8192", "-rss_limit_mb=4096"


def unpacked(target: str, folder: Path) -> Path:
    """`folder`, with the corpus in it. It is the smallest set with all branches that long runs have reached, which
    libFuzzer finds with -set_cover_merge=1.
    """
    with zipfile.ZipFile(DATA / "fuzz" / f"{target}.zip") as corpus:
        corpus.extractall(folder)
    return folder


def fuzz(target: str, corpus: Path, artifacts: Path, *options: str) -> subprocess.CompletedProcess:
    """Run libFuzzer in a process of its own. It adds to `corpus` and writes what broke a promise to `artifacts`."""
    command = [sys.executable, "-m", "fuzz.guided", target, *LIMITS, f"-artifact_prefix={artifacts}/", *options, corpus]
    return subprocess.run(command, cwd=TESTS, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
