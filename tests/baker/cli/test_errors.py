"""What ends a command: one line and a documented exit code, whatever went wrong."""

import os
import subprocess
import sys

import pytest
from repository import DATA, SCENES

from gsgi.baker.cli import main
from gsgi.baker.cli.commands import doctor

CORNELL, BAKED = SCENES / "cornell.glb", DATA / "v6_surface.gsgi"
RAISES = """
from gsgi.baker.cli import main
from gsgi.baker.cli.commands import doctor
def run(options):
    {}
doctor.run = run
main.main(["doctor"])
"""


def started(code: str, **options) -> subprocess.CompletedProcess:
    command = [sys.executable, "-c", RAISES.format(code)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, **options)


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (MemoryError(), 4, "out of memory"),
        (MemoryError("Unable to allocate 9.2 MiB"), 4, "out of memory: Unable to allocate 9.2 MiB"),
        (ImportError("libOpen3D.so.0.20: failed to map segment from shared object"), 4, "out of memory: libOpen3D"),
        (OSError(12, "Cannot allocate memory"), 4, "out of memory"),
        (RuntimeError("std::bad_alloc"), 4, "out of memory: std::bad_alloc"),
        (ImportError("libusb-1.0.so.0: cannot open shared object file"), 5, "libusb-1.0.so.0: cannot open"),
    ],
)
def test_one_line_and_a_documented_code(monkeypatch, capsys, error, code, line):
    def run(options):
        raise error

    monkeypatch.setattr(doctor, "run", run)
    assert main.run(["doctor"]) == code
    told = capsys.readouterr().err
    assert told.startswith(f"gsgi: {line}")
    assert told.count("\n") == 1


def test_too_little_memory_is_told_by_the_command_itself():
    def limit():
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (700 << 20, 700 << 20))

    run = started("import numpy; numpy.ones(1 << 30)", preexec_fn=limit, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    assert (run.returncode, run.stderr.count("\n")) == (4, 1), run.stderr
    assert run.stderr.startswith("gsgi: out of memory: Unable to allocate 8.00 GiB")


def test_a_bug_of_ours_shows_where_and_is_no_wrong_command_line():
    run = started("assert False, 'values'")
    assert run.returncode == 4
    assert run.stderr.endswith("AssertionError: values\n")


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&1 | head -c 0"])
def test_a_log_that_cannot_be_written_ends_no_bake(tmp_path, redirection):
    code = "import time\n    from gsgi.baker.cli.console import tell\n"
    code += f"    for _ in range(9): tell('x'); time.sleep(0.01)\n    open({str(tmp_path / 'x')!r}, 'w')"
    (tmp_path / "run.py").write_text(RAISES.format(code))
    command = f"set -o pipefail; {sys.executable} {tmp_path / 'run.py'} {redirection}"
    run = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert (tmp_path / "x").exists()


@pytest.mark.parametrize(("redirection", "told"), [(">&-", ""), ("2>&-", "{")])
def test_closed_streams_are_no_error(redirection, told):
    command = f"{sys.executable} -m gsgi.baker inspect {BAKED} --json {redirection}"
    run = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60, check=False)
    assert (run.returncode, run.stdout[:1], run.stderr) == (0, told, "")


def test_names_that_the_terminal_cannot_show_are_escaped():
    run = started("print('Küche')", env=os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    assert (run.returncode, run.stdout) == (0, "K\\xfcche\n"), run.stderr
