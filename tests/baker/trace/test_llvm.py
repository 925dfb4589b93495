"""The choice of LLVM: probed in a child process, named when it fails."""

from pathlib import Path

import pytest

from gsgi.baker.trace import llvm
from gsgi.runtime.errors import UnsupportedError


def test_what_is_chosen_works(monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    chosen = llvm.select()
    assert chosen.exists()
    versions = {path: version for version, path in llvm.libraries()}
    assert versions[chosen] >= llvm.VERSION_MIN


def test_modules_in_the_current_folder_do_not_count(monkeypatch, tmp_path):
    """The probe took a user's re.py for Python's, and LLVM for missing."""
    (tmp_path / "re.py").write_text("raise SystemExit(1)", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    assert llvm.select().exists()


def test_a_library_that_is_none_does_not_work():
    assert not llvm.works(Path("/nonexistent.so"))
    assert not llvm.works(Path(__file__))


def test_old_versions_are_never_tried(monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(llvm, "libraries", lambda: [(16, Path("/lib/libLLVM-16.so"))])
    monkeypatch.setattr(llvm, "works", lambda path: pytest.fail(f"{path} would abort the process"))
    with pytest.raises(UnsupportedError, match="libllvm19"):
        llvm.select()


@pytest.mark.parametrize(("answer", "expected"), [("3.0", True), ("2.0", False)])
def test_a_slow_machine_is_told_and_waited_for(monkeypatch, caplog, answer, expected):
    monkeypatch.setattr(llvm, "SLOW", 0.01)
    monkeypatch.setattr(llvm, "_PROBE", f"import time; time.sleep(0.2); print({answer})")
    assert llvm.works(Path("/lib/libLLVM-19.so")) is expected
    (message,) = caplog.messages
    assert message == "this machine is slow: /lib/libLLVM-19.so has not compiled a kernel yet; waiting on"


def test_no_answer_is_no_refusal(monkeypatch, caplog):
    monkeypatch.setattr(llvm, "SLOW", 0.01)
    monkeypatch.setattr(llvm, "GIVE_UP", 0.01)
    monkeypatch.setattr(llvm, "_PROBE", "while True: pass")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/lib/libLLVM-19.so")
    assert llvm.select() == Path("/lib/libLLVM-19.so")
    assert [message.rpartition("; ")[2] for message in caplog.messages] == ["waiting on", "going on untested"]


@pytest.mark.parametrize("end", ["os.kill(os.getpid(), 9)", "sys.exit('libz.so: failed to map segment')"])
def test_too_little_memory_is_no_unsuitable_llvm(monkeypatch, end):
    monkeypatch.setattr(llvm, "_PROBE", f"import os, sys; {end}")
    with pytest.raises(MemoryError, match="libLLVM-19"):
        llvm.works(Path("/lib/libLLVM-19.so"))
