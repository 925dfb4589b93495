"""Files that are whole or absent: through full disks, limits, errors, and the end of the process."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gsgi.runtime import atomic
from gsgi.runtime.atomic import check_writable, remove_leftovers, replacing, write_atomic, write_together
from gsgi.runtime.errors import FileError
from gsgi.runtime.files import read_file


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_as_a_whole(tmp_path):
    path = tmp_path / "a.bin"
    write_atomic(path, b"one")
    write_atomic(path, b"two")
    assert path.read_bytes() == b"two"
    assert names(tmp_path) == ["a.bin"]


def test_a_block_that_raises_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")

    def fail() -> None:
        with replacing(path) as temporary:
            temporary.write_bytes(b"half")
            raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        fail()
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["a.bin"]


def remove_after(looks: int, path: Path, monkeypatch) -> None:
    """Remove `path` as soon as its status has been read `looks` times, as another process might."""
    look, left = Path.stat, [looks]

    def look_and_remove(self, **how):
        status = look(self, **how)
        left[0] -= self == path
        if not left[0]:
            path.unlink(missing_ok=True)
        return status

    monkeypatch.setattr(Path, "stat", look_and_remove)


@pytest.mark.parametrize("looks", [1, 2, 3])
def test_a_file_that_another_process_removes_is_written_all_the_same(tmp_path, monkeypatch, looks):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    remove_after(looks, path, monkeypatch)
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"


def test_a_file_that_vanishes_before_it_is_read_is_named_as_absent(tmp_path, monkeypatch):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    remove_after(1, path, monkeypatch)
    with pytest.raises(FileError, match=r"a\.bin: cannot read: No such file or directory"):
        read_file(path)


def test_of_files_that_belong_together_the_first_is_last(tmp_path, monkeypatch):
    order, replace = [], os.replace
    monkeypatch.setattr(atomic.os, "replace", lambda old, new: (order.append(new.name), replace(old, new)))
    write_together({tmp_path / "data": b"new", tmp_path / "about it": b"its"})
    assert order == ["about it", "data"]
    assert (tmp_path / "data").read_bytes() == b"new"
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError, match="folder: cannot write: not a regular file"):
        write_together({tmp_path / "data": b"newer", tmp_path / "folder": b""})
    assert (tmp_path / "data").read_bytes() == b"new"
    assert names(tmp_path) == ["about it", "data", "folder"]


def test_a_full_disk_is_named_and_corrupts_nothing(small_disk):
    path = small_disk / "folder" / "a.bin"
    path.parent.mkdir()
    write_atomic(path, b"old")
    with pytest.raises(FileError) as caught:
        write_atomic(path, bytes(1 << 20))
    message = str(caught.value)
    assert message.startswith(f"{path}: cannot write: No space left on device: ")
    assert message.endswith(f" bytes are free on the disk at {small_disk}")
    assert caught.value.exit_code == 2
    assert path.read_bytes() == b"old"
    assert names(path.parent) == ["a.bin"]
    write_atomic(path, b"new")  # what the failed attempt took is free again
    assert path.read_bytes() == b"new"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_disk_that_tells_late_that_it_is_full(tmp_path, monkeypatch, number):
    def full(_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FileError, match=r"a.bin: cannot write: .*: \d+ bytes are free on the disk at /"):
        write_atomic(tmp_path / "a.bin", b"new")
    assert names(tmp_path) == []


def test_a_limit_on_file_size_leaves_nothing(tmp_path):
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "from gsgi.runtime.atomic import write_atomic\n"
        "write_atomic(sys.argv[1], bytes(10000))"
    )
    run = subprocess.run([sys.executable, "-c", code, tmp_path / "a.bin"], capture_output=True, text=True, check=False)
    assert "FileError" in run.stderr
    assert "a.bin: cannot write: File too large" in run.stderr
    assert names(tmp_path) == []


def test_leftovers_go_when_they_are_old_and_nothing_else_does(tmp_path):
    leftover = f".gsgi-{'0a' * 16}.tmp"
    kept = ["a.tmp", ".gsgi-notes.tmp", f".gsgi-{'0b' * 16}.tmp"]
    for name in [leftover, *kept]:
        (tmp_path / name).write_bytes(b"")
    long_ago = time.time() - 2 * atomic.LEFTOVER_AGE
    for name in [leftover, *kept[:2]]:
        os.utime(tmp_path / name, (long_ago, long_ago))
    check_writable(tmp_path / "out.gsgi")
    assert names(tmp_path) == sorted(kept)
    remove_leftovers(tmp_path, age=0)
    assert names(tmp_path) == sorted(kept[:2])


def test_what_is_unfinished_can_be_removed_before_the_process_ends(tmp_path):
    def interrupt() -> None:
        with replacing(tmp_path / "a.bin") as temporary:
            temporary.write_bytes(b"half")
            atomic.discard_unfinished()
            assert names(tmp_path) == []

    with pytest.raises(FileError):
        interrupt()
