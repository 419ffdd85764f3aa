"""A disk without room is told from a folder that is gone."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from massprops.run.full_disk import disk_full


def test_a_folder_that_was_removed_is_no_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not disk_full(tmp_path) and not list(tmp_path.iterdir())
    assert not disk_full(tmp_path / "removed")

    def full(path: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "no space left on device", str(path))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert disk_full(tmp_path)
