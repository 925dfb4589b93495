"""Finished tasks on disk: found again, or absent; never damaged, never in the way."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gsgi.baker.cache.store import Cache, MemoryCache, clear, default_folder, entries, size_limit, task_key
from gsgi.runtime.errors import FileError, UsageError

ARRAYS = {
    "image": np.arange(24, dtype=np.float32).reshape(2, 4, 3),
    "valid": np.array([True, False]),
    "none": np.empty((0, 3), np.float32),
    "count": np.array(7),
}


def key(number: int, stage: str = "view") -> str:
    return task_key(stage, number=number)


def assert_same(found: dict[str, np.ndarray]) -> None:
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def aged(folder, number: int, age: float) -> None:
    path = next(folder.glob(key(number) + "*"))
    os.utime(path, (path.stat().st_mtime - age,) * 2)


def test_arrays_are_found_again_by_another_run(tmp_path):
    folder = tmp_path / "a" / "b"
    assert Cache(folder).get(key(1)) is None
    Cache(folder).put(key(1), ARRAYS)
    assert_same(Cache(folder).get(key(1)))
    assert Cache(folder).get(key(2)) is None
    Cache(folder).remove(key(1))
    assert Cache(folder).get(key(1)) is None


def test_without_a_folder_nothing_is_kept():
    cache = Cache()
    cache.put(key(1), ARRAYS)
    cache.remove(key(1))
    cache.trim()
    assert cache.get(key(1)) is None


def test_a_damaged_entry_counts_as_absent_and_is_replaced(tmp_path):
    cache = Cache(tmp_path)
    cache.put(key(1), ARRAYS)
    path = entries(tmp_path)[0].path
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        assert cache.get(key(1)) is None, length
    for position in range(len(whole)):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 16]) + whole[position + 1 :])
        assert cache.get(key(1)) is None, position
    path.write_bytes(whole + b"\0")
    assert cache.get(key(1)) is None
    cache.put(key(1), ARRAYS)
    assert_same(cache.get(key(1)))


def test_an_entry_under_another_name_counts_as_absent(tmp_path):
    cache = Cache(tmp_path)
    cache.put(key(1), ARRAYS)
    path = entries(tmp_path)[0].path
    path.rename(path.with_name(f"{key(2)}.gsgi-task"))
    assert cache.get(key(2)) is None


def test_the_least_recently_used_go_first_but_none_of_this_run(tmp_path):
    earlier = Cache(tmp_path)
    for number in range(5):
        earlier.put(key(number), ARRAYS)
    size = entries(tmp_path)[0].bytes
    for number in range(5):
        aged(tmp_path, number, age=100 - number)
    now = Cache(tmp_path, limit=3 * size)
    assert now.get(key(0)) is not None  # the oldest, but used by this run
    now.trim()
    kept = {number for number in range(5) if Cache(tmp_path).get(key(number)) is not None}
    assert kept == {0, 3, 4}
    tight = Cache(tmp_path, limit=0)
    tight.put(key(9), ARRAYS)
    tight.trim()
    assert [entry.path.name for entry in entries(tmp_path)] == [f"{key(9)}.gsgi-task"]


def test_clearing_removes_only_what_is_ours(tmp_path):
    Cache(tmp_path).put(key(1), ARRAYS)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / f".gsgi-{'00' * 16}.tmp").write_bytes(b"half")
    clear(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    clear(tmp_path / "nowhere")


def test_a_cache_that_cannot_be_written_warns_once(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    lines = []
    cache = Cache(blocked, warn=lines.append)
    for number in range(3):
        cache.put(key(number), ARRAYS)
        assert cache.get(key(number)) is None
    cache.trim()
    assert len(lines) == 1
    assert str(blocked) in lines[0]
    assert "warning" not in lines[0]  # whoever prints it says so
    with pytest.raises(FileError, match="cannot read"):
        entries(blocked)


def test_a_full_disk_stops_the_cache_and_harms_no_entry(small_disk):
    lines = []
    cache = Cache(small_disk / "cache", warn=lines.append)
    cache.put(key(1), ARRAYS)
    cache.put(key(2), {"large": np.zeros(1 << 20)})
    cache.put(key(3), ARRAYS)
    assert len(lines) == 1
    assert f"on the disk at {small_disk}" in lines[0]
    assert_same(Cache(small_disk / "cache").get(key(1)))
    assert len(list((small_disk / "cache").iterdir())) == 1


HAMMER = """
import sys
import numpy as np
from pathlib import Path
from gsgi.baker.cache.store import Cache, MemoryCache, clear, task_key
rng = np.random.default_rng(int(sys.argv[2]))
folder, hits = Path(sys.argv[1]), 0
def warn(line): raise AssertionError(line)
for _ in range(300):
    cache, number = Cache(folder, 20_000, warn), int(rng.integers(8))
    found = cache.get(task_key("view", number=number))
    assert found is None or (found["x"] == number).all()
    hits += found is not None
    cache.put(task_key("view", number=number), {"x": np.full(1000, number)})
    cache.trim()
assert hits
"""


def test_several_processes_share_a_folder(tmp_path):
    command = [sys.executable, "-c", HAMMER, str(tmp_path)]
    runs = [subprocess.Popen([*command, str(seed)], stderr=subprocess.PIPE, text=True) for seed in range(3)]
    logs = [run.communicate()[1] for run in runs]
    assert [run.returncode for run in runs] == [0, 0, 0], logs
    assert 0 < sum(entry.bytes for entry in entries(tmp_path)) <= 40_000


def test_a_folder_that_another_process_removes_has_no_entries(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "exists", lambda self: True)  # what a look had found, a moment ago
    assert entries(tmp_path / "absent") == []


def test_the_folder_is_where_the_environment_says(monkeypatch):
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.delenv("GSGI_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert str(default_folder()) == "/home/me/.cache/gsgi"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the XDG specification
    assert str(default_folder()) == "/home/me/.cache/gsgi"
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert str(default_folder()) == "/xdg/gsgi"
    monkeypatch.setenv("GSGI_CACHE", "/mine")
    assert str(default_folder()) == "/mine"


def test_the_limit_is_read_in_bytes(monkeypatch):
    monkeypatch.delenv("GSGI_CACHE_LIMIT", raising=False)
    assert size_limit() == 4 << 30
    for text, expected in (("0B", 0), ("500MB", 500_000_000), ("1.5 GiB", 3 << 29), ("10kib", 10240), ("2TB", 2e12)):
        monkeypatch.setenv("GSGI_CACHE_LIMIT", text)
        assert size_limit() == expected
    for text in ("10", "-1GB", "much", "1e3GB", "5XB"):
        monkeypatch.setenv("GSGI_CACHE_LIMIT", text)
        with pytest.raises(UsageError, match="GSGI_CACHE_LIMIT"):
            size_limit()


def test_entries_move_between_caches_as_they_are(tmp_path):
    memory, folder = MemoryCache(), Cache(tmp_path)
    memory.put(key(1), ARRAYS)
    assert memory.holds(key(1))
    assert not folder.holds(key(1))
    folder.keep(key(1), memory.packed(key(1)))
    assert folder.holds(key(1))
    assert_same(folder.get(key(1)))
    assert folder.packed(key(1)) == memory.packed(key(1))
    memory.remove(key(1))
    assert memory.packed(key(1)) is None
    assert memory.get(key(1)) is None


def test_what_a_block_uses_is_recorded_and_what_it_removes_is_not(tmp_path):
    cache = Cache(tmp_path)
    cache.put(key(1), ARRAYS)
    cache.put(key(2), ARRAYS)
    with cache.recording() as used:
        cache.get(key(1))
        cache.put(key(3), ARRAYS)
        cache.put(key(4), ARRAYS)
        cache.remove(key(4))
        cache.get(key(5))
    assert used == {key(1), key(3)}
    assert cache.used == {key(1), key(2), key(3)}
