"""Interrupts wait for calls that they must not leave half-way, and what called can go on after them."""

import signal
import subprocess
import sys
import threading

import pytest

from gsgi.baker.interrupts import SIGNALS, uninterrupted


@pytest.mark.parametrize("number", SIGNALS)
def test_a_handler_is_called_once_at_the_end_of_the_block(number):
    told = []
    before = signal.signal(number, lambda arrived, _: told.append(arrived))
    try:
        with uninterrupted():
            for _ in range(2):
                signal.raise_signal(number)
            assert told == []
        assert told == [number]
        signal.raise_signal(number)
        assert told == [number, number]
    finally:
        signal.signal(number, before)


@uninterrupted()
def fail(*arriving: int) -> None:
    for number in arriving:
        signal.raise_signal(number)
    raise ZeroDivisionError


def test_an_exception_of_the_block_goes_on_where_nothing_arrived():
    before = [signal.getsignal(number) for number in SIGNALS]
    with pytest.raises(ZeroDivisionError):
        fail()
    with pytest.raises(KeyboardInterrupt):
        fail(signal.SIGINT)
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_what_python_does_not_handle_stays_so():
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with uninterrupted():
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)


def test_threads_may_not_set_handlers_and_need_not():
    done = []

    def work():
        with uninterrupted():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done


# Each interrupt finds the main thread waiting for threads that search.
SEARCH = """
import os, signal, threading, time
import numpy as np
from gsgi.baker.neighbours import Neighbours
points, asked = np.random.default_rng(0).random((20_000, 3)), np.random.default_rng(1).random((40_000, 3))
expected = Neighbours(points).nearest(asked, 8)
for _ in range(5):
    threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        while True:
            Neighbours(points).nearest(asked, 8)
    except KeyboardInterrupt:
        pass
    time.sleep(0.1)  # threads that were left would search on
assert all(map(np.array_equal, Neighbours(points).nearest(asked, 8), expected))
"""

# An interrupt that arrives while the library is loaded, which then has to work.
LOAD = """
import os, signal, sys, threading
from gsgi.baker.trace import llvm, mitsuba_scene
from gsgi.baker.views.open3d_module import load_open3d
load = {"open3d": load_open3d, "mitsuba": mitsuba_scene.load_mitsuba}[sys.argv[1]]
llvm.select()  # processes of its own, which end with this one
llvm.select = lambda: None
threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    load()
except KeyboardInterrupt:
    module = load()
if sys.argv[1] == "open3d":
    assert module.core.Tensor([1.0]).numpy() == [1]
else:
    import drjit
    assert drjit.sum(module.Float(1, 2))[0] == 3
"""


@pytest.mark.parametrize("code", [[SEARCH], [LOAD, "open3d"], [LOAD, "mitsuba"]], ids=["search", "open3d", "mitsuba"])
def test_a_process_that_was_interrupted_goes_on(code):
    run = subprocess.run([sys.executable, "-c", *code], stderr=subprocess.PIPE, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
