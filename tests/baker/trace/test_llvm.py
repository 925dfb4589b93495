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


def test_a_library_that_is_none_does_not_work():
    assert not llvm.works(Path("/nonexistent.so"))
    assert not llvm.works(Path(__file__))


def test_old_versions_are_never_tried(monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(llvm, "libraries", lambda: [(16, Path("/lib/libLLVM-16.so"))])
    monkeypatch.setattr(llvm, "works", lambda path: pytest.fail(f"{path} would abort the process"))
    with pytest.raises(UnsupportedError, match="libllvm19"):
        llvm.select()
