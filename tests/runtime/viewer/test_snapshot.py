"""Pictures that the viewer writes."""

import os

import numpy as np
import pytest

from gsgi.runtime.errors import FileError
from gsgi.runtime.image import read_image
from gsgi.runtime.viewer.snapshot import write_snapshot

IMAGE = np.random.default_rng(0).integers(0, 256, (200, 300, 3), np.uint8)


def test_each_has_the_next_free_number(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room-002.png").write_text("mine")
    assert [str(write_snapshot("room", IMAGE)) for _ in range(2)] == ["room-001.png", "room-003.png"]
    assert (tmp_path / "room-002.png").read_text() == "mine"
    assert np.array_equal(np.round(255 * read_image("room-003.png")), IMAGE)


def test_a_folder_that_is_gone_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError, match=r"^gone/room-001\.png: cannot write: No such file"):
        write_snapshot("gone/room", IMAGE)


def test_a_full_disk_leaves_no_file(small_disk, monkeypatch):
    monkeypatch.chdir(small_disk)
    with pytest.raises(FileError, match=r"room-001\.png"):
        write_snapshot("room", IMAGE)
    assert os.listdir() == []
