"""Mitsuba as it is loaded."""

import os
import subprocess
import sys

import numpy as np
import pytest

from gsgi.baker.trace.mitsuba_scene import load_mitsuba, on_device

LOAD = "from gsgi.baker.trace.mitsuba_scene import load_mitsuba; load_mitsuba()"


def loaded(**environment: str) -> str:
    """What a process that loads Mitsuba prints on stderr."""
    others = {name: value for name, value in os.environ.items() if name not in ("HOME", "DRJIT_CACHE_DIR")}
    command = [sys.executable, "-c", LOAD]
    return subprocess.run(command, env=others | environment, stderr=subprocess.PIPE, text=True, check=True).stderr


@pytest.mark.parametrize("home", [{}, {"HOME": "/proc"}], ids=["missing", "read-only"])
def test_a_home_that_cannot_be_written_is_no_news(home):
    assert loaded(**home) == ""


def test_a_folder_for_kernels_that_was_asked_for_is_named_where_it_does_not_work():
    assert "/proc/kernels" in loaded(HOME="/proc", DRJIT_CACHE_DIR="/proc/kernels")


def test_one_kernel_reads_arrays_wherever_they_lie_in_memory():
    mi = load_mitsuba()
    import drjit as dr

    def kernel(skipped: int) -> str:
        """The hash of a kernel that reads four rows of an array which begins so many numbers after another."""
        numbers = np.arange(skipped + 16, dtype=np.float32)[skipped:]
        table = on_device(mi.Float, numbers)
        dr.kernel_history_clear()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            rows = dr.gather(mi.Vector4f, table, dr.arange(mi.UInt32, 4))
            dr.eval(rows)
        assert (numbers.reshape(4, 4) == np.array(rows).T).all()
        (found,) = (each["hash"] for each in dr.kernel_history() if each["type"] == dr.KernelType.JIT)
        return found

    assert len({kernel(skipped) for skipped in range(16)}) == 1
